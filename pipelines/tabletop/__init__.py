"""Frames of tabletop scenes: support plane, segments, regions, filled depth."""
