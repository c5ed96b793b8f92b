"""Training data made from a dataset: affordance, packed regions, detector frames, COCO."""
