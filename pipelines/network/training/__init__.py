"""Training of the grasp network: labelled regions, augmentation, matching and losses."""
