"""Grasps in the formats of other programs."""
