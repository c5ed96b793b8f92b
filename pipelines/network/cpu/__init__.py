"""Faster kernels for the CPU, equal to plain torch: neighbours, groups, RoI align."""
