"""Grasp representations of the methods that the paper compares with."""
