"""Simulated trials of grasps: a table with objects, a gripper, and success rates."""
