"""Augmented labels fit the augmented points."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pipelines.configs import AugmentationConfig
from pipelines.network.training import augmentation
from pipelines.network.training.region_batch import RegionBatch
from tests.network.toy_regions import toy_batch

seeds = st.integers(0, 2**31 - 1)
STILL = AugmentationConfig(jitter=0.0)


def mirrored(points, normal, center):
    return points - 2.0 * ((points - center) @ normal)[..., None] * normal


def generators(seed, count=3):
    return [np.random.default_rng((seed, number)) for number in range(count)]


def distances(first, second):
    """Return all distances, without matrix products, which lose half the digits of short ones."""
    return torch.cdist(first, second, compute_mode="donot_use_mm_for_euclid_dist")


@settings(max_examples=15, deadline=None)
@given(seeds)
def test_planes_and_axes_move_with_the_points(seed):
    batch = toy_batch(3, 32, seed)
    moved = augmentation.augment(batch, STILL, generators(seed))
    for row, slot in ((0, 0), (0, 1), (0, 2), (1, 0)):
        before = mirrored(batch.points[row], batch.direction[row, slot], batch.center[row, slot])
        after = mirrored(moved.points[row], moved.direction[row, slot], moved.center[row, slot])
        scale = moved.points[row].norm() / batch.points[row].norm()
        torch.testing.assert_close(
            distances(after, moved.points[row]),
            scale * distances(before, batch.points[row]),
            rtol=1e-3, atol=2e-5,
        )  # fmt: skip
    for row, slot in ((1, 3), (2, 4)):  # the can's axis, the ball's centre
        scale = moved.points[row].norm() / batch.points[row].norm()
        torch.testing.assert_close(
            off_axis(moved, row, slot), scale * off_axis(batch, row, slot), rtol=1e-3, atol=2e-5
        )


def off_axis(batch, row, slot):
    """Return the distances of points from a slot's centre, and along its axis, if it has one."""
    offset = batch.points[row] - batch.center[row, slot]
    along = (offset @ batch.direction[row, slot]).abs()
    return torch.stack([offset.norm(dim=-1), along])


def test_the_table_keeps_its_place_below_the_points():
    batch = replace(toy_batch(3, 32), ground=torch.tensor([0.03, 0.0, 0.05]))
    moved = augmentation.augment(batch, STILL, generators(1))
    scale = moved.points.flatten(1).norm(dim=-1) / batch.points.flatten(1).norm(dim=-1)
    # Views are tilted a little, and the height is not corrected for that.
    torch.testing.assert_close(moved.ground, scale * batch.ground, rtol=0.05, atol=0.0)
    assert float((moved.ground / batch.ground - 1.0)[[0, 2]].abs().min()) > 1e-3


@settings(max_examples=15, deadline=None)
@given(seeds)
@example(6493)  # little of the box is seen
@example(1649)  # a direction nearly perpendicular
@example(786)  # likewise
def test_a_scaled_copy_keeps_every_plane_and_axis(seed):
    batch = toy_batch(2, 32, seed, tumbled=True)  # a box, a can
    scaled = augmentation.scaled_copy(batch, STILL, generators(seed, 2))
    # Mirroring and then scaling must equal scaling and then mirroring.
    for row, slot in ((0, 0), (0, 1), (0, 2), (1, 0)):
        points, center = batch.points[row], batch.center[row, slot]
        A = torch.linalg.lstsq(points, scaled.points[row]).solution
        image = mirrored(points, batch.direction[row, slot], center) @ A
        expected = mirrored(
            scaled.points[row], scaled.direction[row, slot], scaled.center[row, slot]
        )
        # A direction may be off by `ALIGNMENT` from one that keeps the symmetry exactly. Scaling
        # along it by s and mirroring then differ, by order, by 2 (s - 1) cos times the distance.
        farthest = float((points - center).norm(dim=-1).max())
        off = 2.0 * (STILL.principal_scale - 1.0) * augmentation.ALIGNMENT * farthest
        torch.testing.assert_close(image, expected, rtol=0.0, atol=off)
    axis, points = batch.direction[1, 3], batch.points[1]
    A = torch.linalg.lstsq(points, scaled.points[1]).solution
    across = torch.linalg.svdvals(A - torch.outer(axis, axis) * (axis @ A @ axis))[:2]
    assert float(across[0] - across[1]) == pytest.approx(0.0, abs=5e-3)


def test_scaling_stays_within_its_limit():
    batch = toy_batch(30, 16)
    scaled = augmentation.scaled_copy(batch, STILL, generators(0, 30))
    ratio = scaled.points.norm(dim=-1) / batch.points.norm(dim=-1).clamp(min=1e-9)
    assert float(ratio.max()) <= STILL.principal_scale + 1e-4
    assert float(ratio.min()) >= 1.0 / STILL.principal_scale - 1e-4
    assert float(ratio.std()) > 0.02


def test_a_region_is_augmented_independently_of_the_rest_of_its_batch():
    batch, config = toy_batch(3, 16), AugmentationConfig()
    whole = augmentation.augment(batch, config, generators(5))
    copies = augmentation.scaled_copy(batch, config, generators(5))
    for row, generator in enumerate(generators(5)):
        alone = augmentation.augment(batch[row : row + 1], config, [generator])
        torch.testing.assert_close(alone.points[0], whole.points[row])
    for row, generator in enumerate(generators(5)):
        alone = augmentation.scaled_copy(batch[row : row + 1], config, [generator])
        torch.testing.assert_close(alone.points[0], copies.points[row])


def test_a_region_with_inconsistent_symmetries_is_not_scaled():
    batch = toy_batch(3, 16)
    box = RegionBatch(*(each[:1].clone() for each in vars(batch).values()))
    lean = float(np.radians(10.0))
    for slot, direction in enumerate(
        ([1.0, 0, 0], [np.sin(lean), np.cos(lean), 0], [0.7, 0, 0.714])
    ):
        box.direction[0, slot] = torch.tensor(direction, dtype=torch.float32)
    copy = augmentation.scaled_copy(box, STILL, generators(0, 1))
    torch.testing.assert_close(copy.points, box.points, atol=1e-6, rtol=0)


def test_every_direction_that_keeps_the_symmetries_is_drawn():
    batch = toy_batch(3, 16)
    box = RegionBatch(*(each[:1] for each in vars(batch).values()))  # three planes across
    drawn = [
        augmentation.principal_directions(box, [np.random.default_rng(seed)])[0][0]
        for seed in range(60)
    ]
    nearest = [int((box.direction[0, :3] @ each).abs().argmax()) for each in drawn]
    assert min(nearest.count(slot) for slot in range(3)) > 5
