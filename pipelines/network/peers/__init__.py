"""The networks of the methods that the paper compares with."""
