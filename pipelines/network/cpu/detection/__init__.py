"""The parts of Mask R-CNN that save time at inference."""
