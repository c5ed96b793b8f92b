"""Grasps as the methods represent them that the paper compares with."""
