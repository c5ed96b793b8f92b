"""DetectedSymmetries of planes, axes and spheres of symmetry of a mesh."""
