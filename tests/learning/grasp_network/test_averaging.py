"""The average of the symmetries that many points predict."""

import torch

from pipelines.learning.grasp_network.region_figures import average_symmetries, weighted_median
from pipelines.network.model import Prediction


def test_opposite_normals_give_one_plane():
    direction = torch.zeros(1, 4, 5, 3)
    direction[0, :, :, 0] = torch.tensor([1.0, -1.0, 1.0, -1.0])[:, None]
    center = torch.ones(1, 4, 5, 3)
    prediction = Prediction(
        torch.zeros(1, 4, 2), *[torch.zeros(1, 4)], torch.zeros(1, 4, 5), center, direction
    )
    existence, means, lines = average_symmetries(prediction, torch.full((1, 4), 0.25))
    torch.testing.assert_close(lines[0, 0].abs(), torch.tensor([1.0, 0.0, 0.0]))
    torch.testing.assert_close(existence, torch.full((1, 5), 0.5))
    torch.testing.assert_close(means, torch.ones(1, 5, 3))


def test_the_median_ignores_a_light_outlier_and_follows_a_heavy_one():
    values = torch.tensor([0.0, 1.0, 100.0]).view(1, 3, 1, 1).expand(1, 3, 1, 3)
    light = weighted_median(values, torch.tensor([[0.4, 0.5, 0.1]]))
    heavy = weighted_median(values, torch.tensor([[0.2, 0.2, 0.6]]))
    assert light[0, 0].tolist() == [1.0] * 3
    assert heavy[0, 0].tolist() == [100.0] * 3
