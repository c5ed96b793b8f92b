"""Grasp and symmetry metrics on arrays."""
