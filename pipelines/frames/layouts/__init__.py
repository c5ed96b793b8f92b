"""Layouts of RGB-D frames on disk: a file per family, the order in `registry`.

A layout lists the frames of one folder, or none if the folder has another layout. The search is
cheap: it reads names, headers and index files, but no images.
"""
