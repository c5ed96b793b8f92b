"""Runs of `infer` over many frames: settings, workers, parts, frames as they arrive."""
