"""`grasps.h5`, its parts and tables, and gripper files."""
