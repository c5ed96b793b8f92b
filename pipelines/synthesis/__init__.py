"""Procedural objects, scenes, sensors and grasp labels with known truth."""
