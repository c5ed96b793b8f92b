"""Training of the region detector, the grasp network and the critics."""
