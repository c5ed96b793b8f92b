"""Colour and depth images that are one frame, by the names of their files and folders."""
