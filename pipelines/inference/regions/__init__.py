"""The regions of one frame, from the detector, depth and colour, and their fitted models."""
