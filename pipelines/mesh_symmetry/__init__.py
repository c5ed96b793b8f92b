"""Symmetries of meshes: detection, verification, symmetric parts, doubt."""
