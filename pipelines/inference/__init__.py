"""Computation of a frame's grasps: models, regions, and work on many frames."""
