"""The critics: small networks over the points of a candidate, and their weights files."""
