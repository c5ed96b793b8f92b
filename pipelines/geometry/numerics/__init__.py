"""Numerical building blocks: compiled loops, sums, quantiles, nearest points."""
