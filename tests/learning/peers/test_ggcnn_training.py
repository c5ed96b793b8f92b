"""GG-CNN's crops and maps, and a training that overfits one frame."""

import numpy as np
import torch
from numpy.testing import assert_allclose

from pipelines.configs import TrainBaselineConfig
from pipelines.grasping.peers.rectangles import angles, rectangle_rows
from pipelines.learning.peers.ggcnn_training import (
    DEPTH_UNITS,
    GGCNNTraining,
    crop,
    map_errors,
    random_crop,
    stacked,
    turned_rows,
)
from pipelines.learning.peers.peer import drawn_batches
from pipelines.network.peers.ggcnn import GGCNN
from tests.learning.by_heart import learned

CONFIG = TrainBaselineConfig().with_schedule(GGCNNTraining.peer.schedule)


def frame() -> dict[str, np.ndarray]:
    """A bar 40 pixels wide on a table, with one grasp across its middle, to the image's right."""
    depth = np.full((120, 160), 6000, np.uint16)
    depth[40:80, 80:120] = 5500
    angle, size, one = np.zeros(1), np.full(1, 48.0), np.ones(1)
    rows = rectangle_rows(np.array([[99.5, 59.5]]), angle, size, size, one)
    return {"depth": depth, "rows": rows.astype(np.float32)}


def test_a_quarter_turn_moves_depth_and_grasp_together():
    for turns in range(4):
        depth, maps = crop(frame(), 40, 0, 120, turns)
        y, x = np.nonzero(depth < -0.02)
        v, u = np.nonzero(maps.quality > 0)
        assert_allclose([u.mean(), v.mean()], [x.mean(), y.mean()], atol=2.0)
        middle = maps.cos[int(v.mean()), int(u.mean())]
        assert_allclose(middle, 1.0 if turns % 2 == 0 else -1.0, atol=1e-6)


def test_four_quarter_turns_change_nothing():
    rows = frame()["rows"].astype(np.float64)
    again = rows
    for _ in range(4):
        again = turned_rows(again, 120)
    assert_allclose(again, rows)
    assert_allclose(abs(angles(turned_rows(rows, 120))), np.pi / 2)


def test_a_zoomed_grasp_opens_wider_in_the_crop():
    _, whole = crop(frame(), 40, 0, 120, 0)
    _, zoomed = crop(frame(), 70, 30, 60, 0)
    assert_allclose(whole.width.max(), 48 * 2.5 / 150, atol=1e-6)
    assert_allclose(zoomed.width.max(), 1.0)  # of 120 px at 300: 48 * 5 / 150, clipped


def test_a_crop_depends_only_on_its_generator():
    first, second = (random_crop(frame(), np.random.default_rng(3)) for _ in range(2))
    assert_allclose(first[0], second[0])


def test_an_epoch_has_the_remaining_steps():
    config = TrainBaselineConfig(
        steps=5, epoch_steps=3, batch_size=2, learning_rate=1e-3, decay_steps=2
    )
    rng = np.random.default_rng(0)
    assert config.epochs == 2
    assert [len(drawn_batches(4, config, number, rng)) for number in (0, 1)] == [3, 2]
    assert sorted(np.concatenate(drawn_batches(4, config, 0, rng)[:2]).tolist()) == [0, 1, 2, 3]


def test_the_network_overfits_one_frame():
    torch.manual_seed(0)
    network = GGCNN(CONFIG.network)
    small = stacked([crop(frame(), 40, 0, 120, 0)])

    def loss():
        return map_errors(network, small, torch.device("cpu"))["total"]

    assert learned(network, loss, share=0.2, rate=3e-3, most_steps=40)
    assert DEPTH_UNITS == 10_000
