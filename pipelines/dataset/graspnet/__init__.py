"""GraspNet-1Billion's own files: layout, scenes' annotations, grasp labels, `.sdf`."""
