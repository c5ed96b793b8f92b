"""Grasps over HTTP: frames in POST requests, and the server that answers them."""
