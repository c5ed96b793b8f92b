"""Symmetries of a region: voted, fitted to its points, with the confidence in each."""
