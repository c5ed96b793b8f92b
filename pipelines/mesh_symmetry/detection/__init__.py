"""Detection of the mirror planes, rotation axes and spheres of a mesh."""
