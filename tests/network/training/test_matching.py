"""Assignment of planes to slots."""

from dataclasses import replace
from itertools import permutations

import pytest
import torch
from scipy.optimize import linear_sum_assignment

from pipelines.network.training.dense_error import reflection_errors
from pipelines.network.training.matching import assign, match_reflections
from tests.network.toy_regions import toy_batch

WEIGHT = torch.full((2, 5), 0.2)


def slots_of(truth):
    return truth.direction[:, None, :3].expand(-1, 5, -1, -1), truth.center[:, None, :3].expand(
        -1, 5, -1, -1
    )


def test_planes_go_to_the_slots_that_predict_them():
    truth = toy_batch(2, 64)
    order = torch.tensor([2, 0, 1, 3, 4])
    shuffled = replace(
        truth,
        existence=truth.existence[:, order],
        center=truth.center[:, order],
        direction=truth.direction[:, order],
    )
    normal, center = slots_of(shuffled)
    matched = match_reflections(truth, truth.points, normal, center, WEIGHT)
    assert torch.equal(matched.existence[0], shuffled.existence[0])
    torch.testing.assert_close(matched.direction[0], shuffled.direction[0])


def test_a_single_plane_takes_the_best_slot_and_leaves_the_others_empty():
    truth = toy_batch(2, 64)  # the second is a can: its plane is in slot 0
    normal = torch.eye(3).expand(2, 5, 3, 3).clone()
    center = torch.zeros(2, 5, 3, 3)
    normal[1, :, 1] = truth.direction[1, 0]
    center[1, :, 1] = truth.center[1, 0]
    matched = match_reflections(truth, truth.points, normal, center, WEIGHT)
    assert matched.existence[1].tolist() == [0.0, 1.0, 0.0, 1.0, 0.0]
    torch.testing.assert_close(matched.center[1, 3], truth.center[1, 3])


def test_empty_slots_of_the_truth_do_not_decide_where_its_plane_goes():
    can = toy_batch(2, 64)[1:2]  # with one plane
    g = torch.Generator().manual_seed(2)
    for _ in range(20):
        normal = torch.nn.functional.normalize(torch.randn(1, 5, 3, 3, generator=g), dim=-1)
        center = 0.02 * torch.randn(1, 5, 3, 3, generator=g)
        truth = can.direction[:, 0], can.center[:, 0]
        errors = [
            float(reflection_errors(can.points, normal[:, :, k], center[:, :, k], *truth).mean())
            for k in range(3)
        ]
        matched = match_reflections(can, can.points, normal, center, WEIGHT[:1])
        expected = [float(error == min(errors)) for error in errors]
        assert matched.existence[0, :3].tolist() == expected


def test_no_other_assignment_of_planes_to_slots_costs_less():
    truth = toy_batch(1, 64)  # a box: three planes
    g = torch.Generator().manual_seed(0)
    normal = torch.nn.functional.normalize(torch.randn(1, 5, 3, 3, generator=g), dim=-1)
    center = 0.02 * torch.randn(1, 5, 3, 3, generator=g)

    def cost(planes):
        errors = [
            reflection_errors(truth.points, normal[:, :, slot], center[:, :, slot], *planes[slot])
            for slot in range(3)
        ]
        return float(sum(error.mean() for error in errors))

    def planes_of(batch, order=(0, 1, 2)):
        return [(batch.direction[:, i], batch.center[:, i]) for i in order]

    matched = match_reflections(truth, truth.points, normal, center, WEIGHT[:1])
    every = [cost(planes_of(truth, order)) for order in permutations(range(3))]
    assert cost(planes_of(matched)) == pytest.approx(min(every), rel=1e-5)
    assert max(every) > 1.05 * min(every)


def test_assignments_equal_those_of_the_hungarian_method():
    cost = torch.rand(50, 3, 3, generator=torch.Generator().manual_seed(1))
    expected = [linear_sum_assignment(matrix)[1].tolist() for matrix in cost.numpy()]
    assert assign(cost).tolist() == expected


def test_costs_that_are_not_finite_still_get_an_assignment():
    given = assign(torch.tensor([[[torch.nan, 1.0, 0.0], [0.0, torch.inf, 1.0], [1.0, 0.0, 2.0]]]))
    assert given.tolist() == [[2, 0, 1]]
