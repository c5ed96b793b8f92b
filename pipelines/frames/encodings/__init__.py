"""Decoders of the file formats of frames: bags, .exr, .mat, .pcd, .yaml, pickles."""
