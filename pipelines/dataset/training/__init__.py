"""Training data made of a dataset: affordance, packed regions, detector frames, COCO."""
