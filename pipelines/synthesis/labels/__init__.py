"""Grasp labels of synthetic objects, as GraspNet-1Billion has them."""
