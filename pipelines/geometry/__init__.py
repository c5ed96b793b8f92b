"""Geometry on arrays: transforms, cameras, clouds, symmetries; metres, radians."""
