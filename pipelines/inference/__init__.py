"""What `infer` does with one frame: models, regions, grasps."""
