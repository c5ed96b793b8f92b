"""Speeds of SymGrasp on this machine: `python -m benchmarks` prints them as a Markdown table."""
