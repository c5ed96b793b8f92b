"""The only code that opens data files: one module an artifact, readers beside writers."""
