"""The evidence for rotation axes and spheres agrees with its names, and true ones are likely."""

import numpy as np
import pytest
import trimesh

from pipelines.geometry.symmetry import RotationSymmetry, SphereSymmetry, SymmetrySlots
from pipelines.geometry.transforms import unit
from pipelines.grasping.scene import SceneCloud
from pipelines.grasping.symmetries.axis_evidence import (
    AXIS_FEATURES,
    FEATURES,
    POINT_FEATURES,
    FittedAxes,
    axis_critic_inputs,
    fitted_axes,
    likely_axis_and_sphere,
)
from pipelines.grasping.symmetries.sources import NETWORK, SHAPE
from pipelines.inference import models
from tests.grasping.symmetries.views import SILENT, evidence_of, view_of, view_of_box

CRITIC = models.symmetry_critics().axes
HEIGHT, RADIUS = 0.1, 0.03


@pytest.fixture(scope="module")
def can():
    return view_of(trimesh.creation.cylinder(RADIUS, HEIGHT, sections=64))


@pytest.fixture(scope="module")
def ball():
    return view_of(trimesh.creation.icosphere(4, 0.035))


@pytest.fixture(scope="module")
def box():
    return view_of_box()


def upright(pose, aside=(0.0, 0.0, 0.0)):
    return RotationSymmetry([0, 0, 1], aside).transformed(pose)


def judged(view, axes):
    """The critic's probability and the features of `axes`, which all have the same shares."""
    sphere, shares = SphereSymmetry(view[2][:3, 3]), np.full((len(axes) + 1, 3), 0.7)
    fitted = FittedAxes(axes, sphere, shares, np.full(len(shares), SHAPE))
    inputs = axis_critic_inputs(fitted, evidence_of(view))
    return CRITIC.probability(*inputs), inputs


def test_a_can_alone_shows_its_axis_without_a_network(can):
    (axis, confidence, source), _ = likely_axis_and_sphere(evidence_of(can), CRITIC)
    truth = upright(can[2])
    assert abs(float(axis.axis @ truth.axis)) > np.cos(np.radians(2))
    assert np.linalg.norm(np.cross(axis.point - truth.point, truth.axis)) < 0.002
    assert confidence > 0.7
    assert source & SHAPE


def test_a_ball_shows_its_centre_and_a_box_neither_axis_nor_centre(ball, box):
    center = ball[2][:3, 3]
    slots = SymmetrySlots(np.full(5, 0.5), np.tile(center, (5, 1)), SILENT.direction)
    sphere, confidence, _ = likely_axis_and_sphere(evidence_of(ball, slots), CRITIC)[1]
    assert np.linalg.norm(sphere.point - center) < 0.003
    assert confidence > 0.5
    axis, sphere_of_box = likely_axis_and_sphere(evidence_of(box), CRITIC)
    assert axis[1] < 0.3
    assert sphere_of_box[1] < 0.1


def test_the_true_axis_is_more_likely_than_axes_beside_it_with_the_same_shares(can):
    pose = can[2]
    axes = [upright(pose), upright(pose, (0.012, 0, 0)), upright(pose, (0, 0.012, 0))]
    probability, _ = judged(can, axes)
    assert probability[0] > 1.5 * probability[1]  # aside as the camera sees it
    assert probability[0] > probability[2]


def test_numbers_of_a_can_agree_with_their_names(can):
    scene, _, pose = can
    points, angles, numbers = judged(can, [upright(pose), upright(pose, (0.02, 0, 0))])[1]
    column = {name: points[..., place] for place, name in enumerate(POINT_FEATURES)}
    number = {name: numbers[:, place] for place, name in enumerate(FEATURES)}
    angle = {name: angles[:, place] for place, name in enumerate(AXIS_FEATURES)}
    assert number["length"][0] == pytest.approx(10 * HEIGHT, abs=0.03)
    assert number["radius"][0] == pytest.approx(10 * RADIUS, abs=0.02)
    assert number["off_middle"][0] < 0.05
    assert number["off_middle"][1] > 0.3
    np.testing.assert_allclose(angle["axis_up"], 1.0, atol=1e-6)
    assert angle["is_sphere"].tolist() == [0.0, 0.0, 1.0]
    wall = np.abs(column["normal_up"][0]) < 0.2  # up is the axis
    assert wall.sum() > 30
    np.testing.assert_allclose(column["normal_radial"][0][wall], 1.0, atol=0.05)
    assert np.median(np.abs(column["normal_tangential"][0])) < 0.01
    assert np.abs(column["normal_tangential"][1]).mean() > 0.1
    apart = np.hypot(column["along_normal"][0], column["along_across"][0])
    np.testing.assert_allclose(apart[wall], 10 * RADIUS, atol=0.02)
    assert (column["along_across"][0][wall] < 0.05).all()  # the seen wall faces the camera
    # The plane through the axis and the camera maps the seen surface to seen surface.
    assert np.median(column["image_distance"][0]) < 0.1
    assert column["image_distance"][1].mean() > 2 * column["image_distance"][0].mean()
    assert scene.plane is not None


def test_an_axis_along_the_line_of_sight_and_a_scene_without_table_give_finite_numbers(can):
    scene, region, pose = can
    middle = region.points.mean(axis=0)
    away = RotationSymmetry(unit(middle), middle)
    aside = unit(np.cross(middle, [1.0, 0.0, 0.0]))
    through_camera = RotationSymmetry(aside, -float(middle @ aside) * aside)
    for plane in (scene.plane, None):
        view = SceneCloud(scene.depth, scene.intrinsics, plane), region, pose
        for inputs in judged(view, [away, through_camera])[1]:
            assert np.isfinite(inputs).all()


def test_the_sense_of_an_axis_does_not_matter(can):
    pose = can[2]
    there, back = upright(pose), RotationSymmetry(-upright(pose).axis, upright(pose).point)
    (first, second, _), _ = judged(can, [there, back])
    assert first == pytest.approx(second, abs=1e-6)


def test_an_axis_that_several_starts_reach_has_all_their_sources(can, monkeypatch):
    pose = can[2]
    axis = upright(pose)
    same = RotationSymmetry(-axis.axis, axis.point + 0.1 * axis.axis)
    beside = upright(pose, (0.012, 0, 0))
    lean = 0.3 * unit(np.cross(axis.axis, [1, 0, 0]))
    tilted = RotationSymmetry(unit(axis.axis + lean), axis.point)
    for other, expected in ((same, NETWORK | SHAPE), (beside, NETWORK), (tilted, NETWORK)):
        fitted = FittedAxes(
            [axis, other, other],
            SphereSymmetry(axis.point),
            np.array([[0.9, 0.8, 1.0], [0.7, 0.7, 1.0], [0.1, 0.1, 0.5], [0.1, 0.1, 0.5]]),
            np.array([NETWORK, SHAPE, SHAPE, NETWORK]),
        )
        monkeypatch.setattr(
            "pipelines.grasping.symmetries.axis_evidence.fitted_axes", lambda _, f=fitted: f
        )
        found = likely_axis_and_sphere(evidence_of(can), CRITIC)[0]
        assert found[2] == expected
        assert found[0] is axis


def test_images_of_a_true_axis_are_consistent_and_the_fit_explains_the_wall(can):
    fitted, truth = fitted_axes(evidence_of(can)), upright(can[2])
    tilt = [float(np.linalg.norm(np.cross(each.axis, truth.axis))) for each in fitted.axes]
    off = [float(np.linalg.norm(np.cross(a.point - truth.point, truth.axis))) for a in fitted.axes]
    best = int(np.argmin(np.add(tilt, off)))
    assert fitted.shares[best, 1] > 0.6
    assert fitted.shares[best, 2] > 0.95
    assert len(fitted.shares) == len(fitted.symmetries) == len(fitted.sources)
