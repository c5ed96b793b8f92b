"""The compared methods of the paper, applied to a frame."""
