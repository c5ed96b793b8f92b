"""Computation of a frame's grasps: models, regions, and runs over many frames."""
