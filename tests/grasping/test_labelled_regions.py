"""Labels of region clouds."""

import numpy as np

from pipelines.grasping.labelled_regions import LabelledSurface


def test_a_point_has_the_affordance_of_the_nearest_surface_point_within_the_radius():
    places = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.02]], np.float32)
    surface = LabelledSurface.of({"points": places, "affordance": np.array([0.25, 0.75], "f4")})
    points = np.array([[0.0, 0.0, 0.009], [0.004, 0.0, 0.013], [0.0, 0.0, 0.031]])
    assert surface.affordance_at(points, 0.01).tolist() == [0.25, 0.75, 0.0]
