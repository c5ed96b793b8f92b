"""Pure geometry on arrays: transforms, cameras, clouds, meshes, symmetries. Metres, radians."""
