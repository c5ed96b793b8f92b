"""Regions of a tabletop frame: pieces by colour, and tests whether a piece may be an object."""
