"""Command line: a module for each command, its options and its report."""
