"""A frame judged exactly and as by graspnetAPI (the peer), on known and on moved scenes."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from pipelines.geometry.meshes.signed_distance import SignedDistanceGrid, signed_distance_grid
from pipelines.geometry.transforms import make_pose, random_rotation
from pipelines.grasping.grasps import GraspPoses, to_graspnet
from pipelines.metrics.graspnet.box_collision import voxel_means
from pipelines.metrics.graspnet.graspnet_ap import FAILED
from pipelines.metrics.graspnet.graspnet_frames import (
    DUMP_REASONS,
    ExactScene,
    GridObject,
    GridScene,
    ScoredRows,
    SolidObject,
    score_rows,
)
from pipelines.metrics.mesh_collision import MeshCollider
from tests.metrics.shapes import ball, box, moved, random_grasps, surface

MESHES = [box(0.06, 0.04, 0.1), ball(0.03)]
CLOUDS = [voxel_means(surface(mesh)[0]) for mesh in MESHES]
SOLIDS = [SolidObject(c, m, MeshCollider(m)) for c, m in zip(CLOUDS, MESHES, strict=True)]
PLACES = [make_pose(np.eye(3), [0, 0, 0.05]), make_pose(np.eye(3), [0.2, 0.0, 0.03])]
DOWN = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # approach along -z, closing along y


@cache
def distances() -> list[SignedDistanceGrid]:
    return [signed_distance_grid(mesh, 60) for mesh in MESHES]


def exact(T=None) -> ExactScene:
    move = np.eye(4) if T is None else T
    return ExactScene(SOLIDS, [move @ place for place in PLACES], np.linalg.inv(move))


def peer() -> GridScene:
    grids = [GridObject(c, g) for c, g in zip(CLOUDS, distances(), strict=True)]
    return GridScene(grids, [place.astype(np.float32) for place in PLACES], np.eye(4))


def rows_of(grasps: GraspPoses, confidence=None) -> np.ndarray:
    """Rows whose finger tips are at the grasps, 2 cm ahead of GraspNet's origin."""
    ranks = np.linspace(0.9, 0.1, len(grasps)) if confidence is None else confidence
    return to_graspnet(grasps, ranks, tip_reach=0.0, depth=0.02)


def grasps_at(*places, width=0.07) -> GraspPoses:
    count = len(places)
    return GraspPoses(np.tile(DOWN, (count, 1, 1)), np.array(places), np.full(count, width))


def words(judged: ScoredRows) -> list[str]:
    return [DUMP_REASONS[reason] for reason in judged.reason]


@pytest.mark.parametrize("scene", [exact(), peer()], ids=["exact", "peer"])
def test_each_kind_of_failure_has_its_name(scene):
    # In the ball's middle, deep in the box, over the box, 24 mm to the side of the ball.
    places = [(0.2, 0, 0.03), (0, 0.025, 0.08), (0, 0, 0.2), (0.224, 0.0, 0.05)]
    judged = score_rows(rows_of(grasps_at(*places)), scene)
    assert words(judged)[:2] == ["held", "collision"]
    assert judged.owner.tolist() == [1, 0, 0, 1]
    assert words(judged)[2] == ("no contact" if isinstance(scene, ExactScene) else "empty")
    assert judged.friction.tolist()[1:3] == [FAILED, FAILED]
    assert judged.friction[0] > 0.0


@pytest.mark.parametrize("scene", [exact(), peer()], ids=["exact", "peer"])
def test_the_table_stops_a_grasp_that_reaches_into_it(scene):
    low, high = grasps_at((0.2, 0, -0.004)), grasps_at((0.2, 0, 0.025))
    assert words(score_rows(rows_of(low), scene)) == ["collision"]
    assert words(score_rows(rows_of(high), scene))[0] != "collision"


def test_a_wall_in_a_fingers_way_is_a_collision_wherever_the_camera_is():
    grasps = grasps_at((0.2, 0, 0.025))
    wall = MeshCollider(moved(box(0.5, 0.05, 0.5), make_pose(np.eye(3), [0.0, 0.065, 0.0])))
    for T in (np.eye(4), make_pose(random_rotation(np.random.default_rng(1)), np.ones(3))):
        rows, among = rows_of(grasps.transformed(T)), replace(exact(T), around=[wall])
        assert words(score_rows(rows, among)) == ["collision"]
        assert words(score_rows(rows, exact(T))) != ["collision"]


@pytest.mark.parametrize("scene", [exact(), peer()], ids=["exact", "peer"])
def test_no_rows_and_no_objects_have_no_verdicts(scene):
    assert len(score_rows(np.zeros((0, 17)), scene).index) == 0
    empty = type(scene)([], [], np.eye(4))
    assert len(score_rows(rows_of(grasps_at((0, 0, 0))), empty).index) == 0


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=8, deadline=None)
def test_moving_grasps_and_scene_together_changes_no_verdict(seed):
    rng = np.random.default_rng(seed)
    T = make_pose(random_rotation(rng), rng.normal(size=3))
    spread = random_grasps(rng, 40, 0.04).transformed(PLACES[rng.integers(2)])
    grasps = GraspPoses(spread.rotation, spread.translation, np.full(40, 0.09))
    confidence = rng.random(40)
    here = score_rows(rows_of(grasps, confidence), exact())
    there = score_rows(rows_of(grasps.transformed(T), confidence), exact(T))
    assert_array_equal(there.index, here.index)
    assert_array_equal(there.owner, here.owner)
    assert (there.friction == here.friction).mean() >= 0.95  # a touch within rounding may differ


def test_the_peer_checks_collisions_within_five_centimetres_of_the_grasped_object():
    # The box is 10 cm high, the ball's lowest point at 15.1 cm, the palm from 14.5 to 15.5 cm.
    above = [PLACES[0], make_pose(np.eye(3), [0.0, 0.0, 0.151 + 0.03])]
    grasp = GraspPoses(DOWN, np.array([0.0, 0.0, 0.085]), np.array(0.06))
    rows = to_graspnet(grasp, [0.5], tip_reach=0.0, depth=0.04)
    single = [pose.astype(np.float32) for pose in above]
    blind = GridScene(peer().objects, single, np.eye(4))
    assert words(score_rows(rows, ExactScene(SOLIDS, above, np.eye(4)))) == ["collision"]
    assert words(score_rows(rows, blind)) != ["collision"]


@pytest.mark.parametrize(("count", "empty"), [(9, True), (10, False)])
def test_the_peer_counts_fewer_than_ten_points_between_the_fingers_as_none(count, empty):
    points = np.stack([np.zeros(count), np.linspace(-0.02, 0.02, count), np.zeros(count)], 1)
    scene = GridScene(
        [GridObject(points, distances()[1])], [PLACES[1].astype(np.float32)], np.eye(4)
    )
    # 3 mm aside the fingers do touch the ball; only the cloud between them is too thin.
    judged = score_rows(rows_of(grasps_at((0.203, 0.0, 0.025))), scene)
    assert words(judged) == ["empty" if empty else "held"]
    assert judged.friction.tolist() == [FAILED if empty else 0.2]


def test_open3ds_voxels_start_half_a_voxel_below_the_lowest_point():
    points = np.array([[0.0, 0, 0], [0.0039, 0, 0], [0.0041, 0, 0], [0.0119, 0, 0]])
    means = np.sort(voxel_means(points)[:, 0])
    assert means == pytest.approx([0.00195, 0.008])
