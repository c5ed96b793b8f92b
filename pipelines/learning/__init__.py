"""What both trainings share: batches, the loop, checkpoints."""
