"""Annotating one object: what is found, what is given, what a person corrects, and its picture."""
