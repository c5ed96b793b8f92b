"""Synthetic scenes: settling, tables, cameras, depth sensors, light."""
