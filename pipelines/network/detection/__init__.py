"""The region detector: Mask R-CNN on depth geometry."""
