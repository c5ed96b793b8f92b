"""The terminal and nothing else: one file a command."""
