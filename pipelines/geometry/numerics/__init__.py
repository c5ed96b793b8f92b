"""Numerical building blocks: compiled loops, sums of fits, quantiles, nearest points."""
