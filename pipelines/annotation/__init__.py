"""Annotation of an object: symmetries detected, given, or corrected by a person."""
