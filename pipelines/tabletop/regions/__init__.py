"""Regions of a tabletop frame: pieces by colour, and tests of what may be a thing."""
