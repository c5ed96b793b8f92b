"""Files of GraspNet-1Billion: layout, annotations of scenes, grasp labels, `.sdf`."""
