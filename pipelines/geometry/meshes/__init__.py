"""Triangle meshes: volume, winding, signed distance, convex pieces."""
