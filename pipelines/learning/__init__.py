"""Training of the region detector and of the grasp network."""
