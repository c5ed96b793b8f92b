"""The evidence for mirror planes agrees with its names, and true planes are likely."""

import numpy as np
import pytest
import trimesh

from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, SymmetrySlots
from pipelines.geometry.transforms import rotation_about, unit
from pipelines.grasping.scene import SceneCloud
from pipelines.grasping.symmetries.plane_candidates import candidate_planes
from pipelines.grasping.symmetries.plane_evidence import (
    FEATURES,
    fitted_planes,
    likely_planes,
    plane_critic_inputs,
)
from pipelines.inference import models
from tests.grasping.symmetries.views import SILENT, evidence_of, view_of_box

CRITIC = models.symmetry_critics().planes
UPRIGHT = RotationSymmetry([0, 0, 1], [9, 9, 9])


@pytest.fixture(scope="module")
def box():
    return view_of_box()


def axis_of(view):
    return RotationSymmetry([0, 0, 1], [0, 0, 0]).transformed(view[2])


def box_planes(pose):
    turn = trimesh.transformations.rotation_matrix(0.6, [0, 0, 1])[:3, :3]
    return [ReflectionSymmetry(normal, [0, 0, 0]).transformed(pose) for normal in turn.T]


def features(planes, known):
    return plane_critic_inputs(planes, known)[2]


def row(plane, known):
    values = features([plane], known)[0]
    return dict(zip(FEATURES, values, strict=True))


def test_a_box_alone_shows_its_three_planes_without_a_network(box):
    found = likely_planes(evidence_of(box), axis_of(box), CRITIC)
    assert len(found) == 3
    confidence = [each for _, each, _ in found]
    assert confidence == sorted(confidence, reverse=True)
    for truth in box_planes(box[2]):
        best = max(found, key=lambda pair: abs(float(pair[0].normal @ truth.normal)))
        assert abs(float(best[0].normal @ truth.normal)) > np.cos(np.radians(5))
        assert abs(float((best[0].point - truth.point) @ truth.normal)) < 0.004
        assert best[1] > 0.3


def test_true_planes_are_more_likely_than_planes_shifted_from_the_middle(box):
    known = evidence_of(box)
    for truth in box_planes(box[2]):
        aside = ReflectionSymmetry(truth.normal, truth.point + 0.02 * truth.normal)
        right, wrong = CRITIC.probability(*plane_critic_inputs([truth, aside], known))
        assert right > 2 * wrong


def test_only_the_more_likely_of_oblique_planes_is_kept(box, monkeypatch):
    across, _, level = box_planes(box[2])
    up = level.normal
    oblique = [
        ReflectionSymmetry(rotation_about(up, np.radians(angle)) @ across.normal, across.point)
        for angle in (60.0, 90.0, 0.0, 45.0)
    ]
    probability = np.array([0.3, 0.2, 0.9, 0.8])
    monkeypatch.setattr(
        "pipelines.grasping.symmetries.plane_evidence.fitted_planes",
        lambda *_: (oblique, np.array([3, 1, 1, 2])),
    )
    monkeypatch.setattr(type(CRITIC), "probability", lambda *_: probability)
    found = likely_planes(evidence_of(box), axis_of(box), CRITIC)
    assert [each for _, each, _ in found] == [0.9, 0.3]  # 90 degrees is within 30 of a kept one
    assert found[0][0] is oblique[2]
    assert [source for _, _, source in found] == [1, 3]


def test_numbers_agree_with_their_names(box):
    known, (across, along, level) = evidence_of(box), box_planes(box[2])
    row_level = row(level, known)
    assert row_level["tilt"] == pytest.approx(1.0, abs=1e-6)
    assert row_level["level"] == 1.0
    assert row_level["off_halfway"] < 0.03
    raised = ReflectionSymmetry(level.normal, level.point + 0.03 * level.normal)
    assert row(raised, known)["off_halfway"] == pytest.approx(0.25, abs=0.04)
    assert row(across, known)["tilt"] < 0.02
    assert row(across, known)["level"] == 0.0
    assert row(along, known)["consistency"] > 0.97
    aside = ReflectionSymmetry(along.normal, along.point + 0.03 * along.normal)
    assert row(aside, known)["consistency"] < 0.8 or row(aside, known)["off_middle"] > 0.2


def test_a_plane_that_the_network_names_is_a_candidate():
    across = ReflectionSymmetry(unit([1.0, 0.4, 0.1]), [0.0, 0.0, 0.6])
    rng = np.random.default_rng(0)
    points = rng.normal([0.0, 0.0, 0.6], 0.02, (300, 3))  # without faces, outline or table
    proposed = SymmetrySlots(
        SILENT.probability.copy(), SILENT.point.copy(), SILENT.direction.copy()
    )
    proposed.probability[1], proposed.point[1], proposed.direction[1] = (
        0.9,
        across.point,
        across.normal,
    )
    for slots, named in ((proposed, True), (SILENT, False)):
        found, _ = candidate_planes(slots, UPRIGHT, points, unit(points), None)
        near = [abs(float(plane.normal @ across.normal)) > 0.9999 for plane in found]
        assert any(near) == named


def test_without_a_table_no_plane_is_level_and_planes_are_found(box):
    scene, region, pose = box
    known = evidence_of((SceneCloud(scene.depth, scene.intrinsics, None), region, pose))
    values = features(fitted_planes(known, axis_of(box))[0], known)
    assert (values[:, FEATURES.index("level")] == 0).all()
    assert np.isfinite(values).all()
    assert len(likely_planes(known, axis_of(box), CRITIC)) == 3


def test_a_moved_table_changes_only_the_numbers_about_the_table(box):
    scene, region, pose = box
    lower = Plane(scene.plane.normal, scene.plane.offset + 0.02)
    low = evidence_of((SceneCloud(scene.depth, scene.intrinsics, lower), region, pose))
    level = box_planes(pose)[2]
    here, there = row(level, evidence_of(box)), row(level, low)
    changed = {name for name in FEATURES if here[name] != pytest.approx(there[name])}
    assert changed == {"off_halfway"}
