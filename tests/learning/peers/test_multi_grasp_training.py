"""Multi-Grasp's images and labels, turned together, and a training that overfits one frame."""

import numpy as np
import torch
from numpy.testing import assert_allclose

from pipelines.configs.peers import PeerNetworkConfig
from pipelines.grasping.peers.rectangles import angles, rectangle_rows
from pipelines.learning.peers.multi_grasp_training import (
    grasp_image,
    grasp_losses,
    moved_image,
)
from pipelines.network.peers.multi_grasp import build_multi_grasp
from tests.learning.by_heart import learned

STILL = np.zeros(2)


def frame() -> dict[str, np.ndarray]:
    pixels = np.full((96, 128, 3), 40, np.uint8)
    pixels[40:56, 60:84] = 200
    each = np.zeros(1), np.full(1, 30.0), np.full(1, 16.0), np.ones(1)
    rows = rectangle_rows(np.array([[71.5, 47.5]]), *each)
    return {"pixels": pixels, "rows": rows.astype(np.float32)}


def test_pixels_and_grasps_are_turned_together():
    pixels, rows = moved_image(frame(), 90.0, np.array([3.0, -2.0]))
    y, x = np.nonzero(pixels[..., 2] > 100)
    assert_allclose(rows[0, :2], [x.mean(), y.mean()], atol=1.0)
    assert_allclose(abs(angles(rows)), np.pi / 2, atol=1e-6)


def test_grasps_whose_box_leaves_the_image_are_no_labels():
    assert len(grasp_image(*moved_image(frame(), 0.0, STILL)).boxes) == 1
    assert len(grasp_image(*moved_image(frame(), 0.0, np.array([50.0, 0.0]))).boxes) == 0


def test_an_image_without_a_grasp_has_a_finite_loss():
    image = grasp_image(*moved_image(frame(), 0.0, np.array([50.0, 0.0])))
    network = build_multi_grasp(PeerNetworkConfig("light")).train()
    terms = grasp_losses(network, [image], torch.device("cpu"), torch.Generator().manual_seed(0))
    assert all(torch.isfinite(term) for term in terms.values())


def test_the_network_overfits_one_frame():
    torch.manual_seed(0)
    network = build_multi_grasp(PeerNetworkConfig("light")).train()
    image = grasp_image(*moved_image(frame(), 0.0, STILL))
    generator = torch.Generator().manual_seed(0)

    def loss():
        return grasp_losses(network, [image, image], torch.device("cpu"), generator)["total"]

    assert learned(network, loss, share=0.35, rate=1e-3, most_steps=25)
