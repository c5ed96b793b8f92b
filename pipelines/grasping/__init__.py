"""Grasps on arrays: grasp frame, grippers, symmetries, feasibility, ranking."""
