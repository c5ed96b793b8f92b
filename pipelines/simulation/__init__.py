"""Trials of grasps in physics: a table with objects, a gripper, and their record."""
