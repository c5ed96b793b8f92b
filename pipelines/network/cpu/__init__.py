"""Faster kernels for the CPU, equal to plain torch: neighbours, pooling, RoI align."""
