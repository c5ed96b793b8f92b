"""A dataset root in GraspNet-1Billion's layout: meshes, labels, symmetries."""
