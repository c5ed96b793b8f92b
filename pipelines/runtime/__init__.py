"""Running many items: batches, worker processes, stop signals."""
