"""The methods that the paper compares with, on a frame."""
