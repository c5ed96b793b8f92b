"""SymmetryNet against its published figures, and its input from a region."""

import numpy as np
import pytest
import torch

from pipelines.configs.peers import PeerNetworkConfig
from pipelines.errors import FormatError
from pipelines.network.peers.symmetrynet import SYMMETRY_MODES, SYMMETRYNET_SIZES, SymmetryNet
from pipelines.network.peers.symmetrynet_input import CROP_SIDE, normalised_colors, region_crop
from pipelines.network.peers.trained import trained_network
from pipelines.network.weights_files import weights_metadata
from pipelines.storage.checkpoints import save_weights

PUBLISHED, CLASSIFIER, INDEX_WEIGHTS, SPHERE_MODE = 24_728_510, 71_189, 1_000, 129


def test_the_full_network_has_the_published_parameters_with_named_exceptions():
    network = SymmetryNet(PeerNetworkConfig("full"))
    count = sum(each.numel() for each in network.parameters())
    assert count == PUBLISHED - CLASSIFIER - INDEX_WEIGHTS + SPHERE_MODE


@pytest.mark.parametrize("variant", SYMMETRYNET_SIZES)
def test_each_point_gives_a_prediction_and_the_order_of_points_does_not_matter(variant):
    torch.manual_seed(0)
    network = SymmetryNet(PeerNetworkConfig(variant)).eval()
    crop, points = torch.rand(1, 3, CROP_SIDE, CROP_SIDE), torch.rand(1, 20, 3)
    pixels, order = torch.randint(0, CROP_SIDE, (1, 20, 2), dtype=torch.uint8), torch.randperm(20)
    with torch.no_grad():
        found = network(crop, pixels, points)
        shuffled = network(crop, pixels[:, order], points[:, order])
    assert found.mirrored.shape == (1, 20, 3, 3)
    assert found.mode.shape == (1, 20, len(SYMMETRY_MODES))
    torch.testing.assert_close(found.mirrored[:, order], shuffled.mirrored)
    torch.testing.assert_close(found.existence[:, order], shuffled.existence)


def test_a_region_elsewhere_has_the_same_symmetries():
    torch.manual_seed(0)
    network = SymmetryNet(PeerNetworkConfig("light")).eval()
    crop, points = torch.rand(1, 3, CROP_SIDE, CROP_SIDE), 0.1 * torch.rand(1, 20, 3)
    pixels = torch.randint(0, CROP_SIDE, (1, 20, 2), dtype=torch.uint8)
    with torch.no_grad():
        here = network(crop, pixels, points)
        there = network(crop, pixels, points + torch.tensor([0.2, -0.1, 0.7]))
    torch.testing.assert_close(there.mirrored, here.mirrored, rtol=1e-3, atol=1e-6)
    torch.testing.assert_close(there.mode, here.mode, rtol=1e-3, atol=1e-6)


def test_points_match_their_pixels_in_the_crop_even_at_the_border_of_the_image():
    color = np.zeros((240, 320, 3), np.uint8)
    mask = np.zeros((240, 320), bool)
    mask[200:240, 100:130] = True
    color[200:220, 100:130] = 200
    rows, columns = np.nonzero(mask)
    crop = region_crop(color, mask, np.stack([columns, rows], axis=1))
    column, row = crop.pixels.T
    assert crop.mask[row, column].mean() > 0.95
    bright = crop.image[row, column, 0] > 100
    assert (bright == (rows < 220)).mean() > 0.95
    assert not crop.image[-1].any()  # beyond the image


def test_an_identity_jitter_does_not_change_the_colours():
    image = torch.randint(0, 256, (2, 8, 8, 3), dtype=torch.uint8)
    torch.testing.assert_close(
        normalised_colors(image, torch.eye(3, 4).expand(2, 3, 4)), normalised_colors(image)
    )


def test_weights_trained_on_metres_are_refused(tmp_path):
    config = PeerNetworkConfig("light")
    tensors = SymmetryNet(config).state_dict()
    path = tmp_path / "w.safetensors"
    save_weights(path, tensors, weights_metadata("SymmetryNet", config))
    trained_network("symmetrynet", path, "cpu")
    del tensors["unit"]
    save_weights(path, tensors, weights_metadata("SymmetryNet", config))
    with pytest.raises(FormatError, match="unit"):
        trained_network("symmetrynet", path, "cpu")
