"""Training of the grasp network."""
