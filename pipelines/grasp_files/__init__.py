"""`grasps.h5`, its shards and tables, and gripper files."""
