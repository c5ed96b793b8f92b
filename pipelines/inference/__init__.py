"""From a frame to its grasps: models, regions, and many frames at once."""
