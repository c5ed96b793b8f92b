"""Grasp candidates of a region: contact pairs across symmetries, from its outline, at random."""
