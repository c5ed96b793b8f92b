"""Decoders of file contents that frames are stored in: bags, .pcd, .mat, pickles, LZF."""
