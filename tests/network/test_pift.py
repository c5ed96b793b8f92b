"""PIFT: deformation and exact inverse, and the identity before training (Eqs. 3-5)."""

import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.network.cpu.folding import folded
from pipelines.network.pift import (
    PIFT,
    POWER_GAIN,
    TYPICAL_SPREAD,
    ConvolutionPIFT,
    rotation_from_6d,
)

seeds = st.integers(0, 2**31 - 1)


def learned_pift(seed):
    torch.manual_seed(seed)
    module = PIFT(4).double()
    torch.nn.init.normal_(module.regress.weight)
    torch.nn.init.normal_(module.power, std=0.1)
    points, features = torch.randn(3, 50, 3).double(), torch.randn(3, 50, 4).double()
    return module(points, features), points


@settings(max_examples=15, deadline=None)
@given(seeds)
def test_undo_maps_deformed_points_back(seed):
    deformation, points = learned_pift(seed)
    torch.testing.assert_close(deformation.undo(deformation.deform(points)), points)


@settings(max_examples=15, deadline=None)
@given(seeds)
def test_the_deformation_turns_first_then_scales_along_the_axes_about_the_centroid(seed):
    deformation, points = learned_pift(seed)
    center = points.mean(1)
    for b in range(3):
        T = torch.diag(deformation.scale[b]) @ deformation.rotation[b]
        expected = (T @ (points[b] - center[b]).T).T + center[b]
        torch.testing.assert_close(deformation.deform(points)[b], expected)


@settings(max_examples=15, deadline=None)
@given(seeds)
def test_planes_and_lines_of_deformed_points_are_mapped_back_with_the_points(seed):
    deformation, points = learned_pift(seed)
    torch.manual_seed(seed)
    first, second = torch.randn(2, 3, 1, 3).double()
    deformed = deformation.deform(torch.cat([points[:, :1], points[:, :1] + first], 1))
    line = deformation.undo_directions(deformed[:, 1:] - deformed[:, :1])
    torch.testing.assert_close(line, torch.nn.functional.normalize(first, dim=-1))
    spanned = deformation.deform(torch.cat([points[:, :1], points[:, :1] + second], 1))
    normal = torch.linalg.cross(deformed[:, 1:] - deformed[:, :1], spanned[:, 1:] - spanned[:, :1])
    across = torch.nn.functional.normalize(torch.linalg.cross(first, second), dim=-1)
    found = deformation.undo_normals(normal)
    torch.testing.assert_close((found * across).sum(-1).abs(), torch.ones(3, 1).double())


@settings(max_examples=15, deadline=None)
@given(seeds)
def test_six_numbers_make_a_rotation(seed):
    R = rotation_from_6d(torch.randn(4, 6, generator=torch.Generator().manual_seed(seed)).double())
    torch.testing.assert_close(R @ R.transpose(1, 2), torch.eye(3).double().expand(4, 3, 3))
    torch.testing.assert_close(torch.linalg.det(R), torch.ones(4).double())


def test_a_new_deformation_is_exactly_the_identity():
    module, points = PIFT(4), torch.randn(2, 50, 3)
    deformation = module(points, torch.randn(2, 50, 4))
    assert torch.equal(deformation.rotation, torch.eye(3).expand(2, 3, 3))
    assert torch.equal(deformation.scale, torch.ones(2, 3))


def test_a_cloud_is_deformed_equally_alone_and_in_a_batch():
    torch.manual_seed(0)
    module = PIFT(4)
    torch.nn.init.normal_(module.regress.weight)
    torch.nn.init.constant_(module.power, -0.1)
    module, points, features = folded(module), torch.randn(5, 50, 3), torch.randn(5, 50, 4)
    with torch.inference_mode():
        together = module(points, features)
        each = [module(points[i : i + 1], features[i : i + 1]) for i in range(5)]
    for i, alone in enumerate(each):
        assert torch.equal(alone.rotation[0], together.rotation[i])
        assert torch.equal(alone.scale[0], together.scale[i])


@settings(max_examples=15, deadline=None)
@given(seeds, st.sampled_from([0.7, 0.8, 1.25, 1.4]), st.integers(0, 2))
def test_the_inverse_spread_undoes_a_scaling_along_an_axis_of_the_frame(seed, factor, axis):
    torch.manual_seed(seed)
    module = PIFT(4).double()
    R = rotation_from_6d(torch.randn(1, 6).double())
    torch.nn.init.constant_(module.power, -1.0 / POWER_GAIN)
    with torch.no_grad():
        module.regress.bias[:6] = R[0, :2].flatten()
    points = TYPICAL_SPREAD * torch.randn(64, 50, 3).double()
    points, features = points - points.mean(1, keepdim=True), torch.randn(64, 50, 4).double()
    scaling = torch.ones(3).double()
    scaling[axis] = factor
    scaled = points @ (R[0].T @ torch.diag(scaling) @ R[0]).T
    same, again = (module(each, features).deform(each) for each in (points, scaled))
    # Except for the bound on scales: single clouds whose spread is near it keep up to a half.
    assert (again - same).norm() < 0.15 * (scaled - points).norm()


def learned_convolution(feature_dim=4, num_points=50):
    torch.manual_seed(0)
    module = ConvolutionPIFT(feature_dim, num_points)
    torch.nn.init.normal_(module.regress.weight)
    return module.eval()


def test_a_new_point_convolution_is_the_identity():
    deformation = ConvolutionPIFT(4, 50)(torch.randn(2, 50, 3), torch.randn(2, 50, 4))
    assert torch.equal(deformation.rotation, torch.eye(3).expand(2, 3, 3))
    assert torch.equal(deformation.scale, torch.ones(2, 3))


def test_a_point_convolution_depends_on_positions_and_features():
    module, points, features = learned_convolution(), torch.randn(2, 50, 3), torch.randn(2, 50, 4)
    first = module(points, features)
    assert not torch.allclose(first.scale, module(2.0 * points, features).scale)
    assert not torch.allclose(first.scale, module(points, features + 1.0).scale)
    moved = module(points + 3.0, features)  # positions are relative to the centre of each group
    torch.testing.assert_close(moved.scale, first.scale, atol=1e-4, rtol=1e-4)


def test_a_folded_point_convolution_deforms_equally_alone_and_in_a_batch():
    module, points, features = learned_convolution(), torch.randn(5, 50, 3), torch.randn(5, 50, 4)
    quick = folded(module)
    with torch.inference_mode():
        plain, together = module(points, features), quick(points, features)
        alone = quick(points[2:3], features[2:3])
    torch.testing.assert_close(together.scale, plain.scale, atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(together.rotation, plain.rotation, atol=1e-5, rtol=1e-4)
    assert torch.equal(alone.scale[0], together.scale[2])
