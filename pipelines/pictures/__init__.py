"""Pictures and pages of frames, grasps and symmetries."""
