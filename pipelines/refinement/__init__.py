"""Symmetric copies of annotated grasps, with contacts found anew."""
