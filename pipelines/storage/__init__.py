"""Files: atomic writes, HDF5, safetensors, provenance, digests."""
