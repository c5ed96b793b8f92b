"""The layouts in which people have RGB-D frames: a file a family, the order in `registry`.

A layout looks at one folder and lists the frames in it, or none if the folder is not of its kind.
To find is cheap: names, headers and index files are looked at, images are not read.
"""
