"""Procedural household objects with known symmetries."""
