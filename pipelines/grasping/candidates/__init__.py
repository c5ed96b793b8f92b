"""Grasp candidates of a region: contact pairs across symmetries, or from its boundary."""
