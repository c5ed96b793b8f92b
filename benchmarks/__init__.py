"""Speeds on this machine (`python -m benchmarks`), ablations, leave-one-out and long runs."""
