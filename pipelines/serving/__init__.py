"""Grasps over HTTP: frames in posts, and the server that answers them."""
