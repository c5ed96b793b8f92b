"""The depth of a frame: its unit, and checks that it is plausible and registered to the colour."""
