"""Regions of a tabletop frame: pieces by colour, and criteria by which a piece may be an object."""
