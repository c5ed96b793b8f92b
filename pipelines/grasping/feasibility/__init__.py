"""Feasibility of a grasp: collision, approach path, limits, image border, visibility."""
