"""Symmetric parts of a mesh that has no symmetry as a whole."""
