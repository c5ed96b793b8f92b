"""Records of runs over a dataset: written, read again, paired by frames."""
