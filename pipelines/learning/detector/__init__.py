"""Training of the region detector."""
