"""Grasps on arrays: the grasp frame, grippers, symmetrizing, decoding, selection."""
