"""Symmetry annotations of a dataset's objects, and their symmetric regions in frames."""
