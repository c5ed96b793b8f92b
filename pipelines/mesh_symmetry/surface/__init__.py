"""The sampled surface of a mesh: samples and rims, canonical pose, profile about an axis."""
