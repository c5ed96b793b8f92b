"""The training loop: runs, checkpoints, data loaders, faults."""
