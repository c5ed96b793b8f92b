"""The camera of a frame: its file, its keys, its lens, its pose in the robot's frame."""
