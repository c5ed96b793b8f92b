"""Checks of `doctor`: packages, torch and GPU, the machine, the default weights."""
