"""Grasp labels of meshes and scenes, in GraspNet-1Billion's form."""
