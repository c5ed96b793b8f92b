"""Symmetric copies of annotated grasps, with newly computed contacts."""
