"""Annotation of an object: symmetries found, given, corrected by a person."""
