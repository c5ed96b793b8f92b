"""Candidate planes of a region include the planes of boxes and cans, from any side."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, SymmetrySlots
from pipelines.geometry.transforms import make_pose, random_rotation, unit
from pipelines.geometry.transforms import transform_points as moved
from pipelines.grasping.symmetries.plane_candidates import candidate_planes, merged_planes
from pipelines.grasping.symmetries.sources import NETWORK, SHAPE
from tests.grasping.symmetries.views import seen_box

UPRIGHT = RotationSymmetry([0, 0, 1], [9, 9, 9])
NOTHING = SymmetrySlots(np.zeros(5), np.full((5, 3), 9.0), np.tile(unit([1.0, 2.0, 3.0]), (5, 1)))


def has_plane(planes, normal, point, degrees=4.0, offset=0.003):
    return any(
        abs(float(plane.normal @ normal)) > np.cos(np.radians(degrees))
        and abs(float((plane.point - point) @ normal)) < offset
        for plane in planes
    )


@settings(max_examples=25)
@given(st.integers(0, 10_000))
def test_all_planes_of_a_box_are_candidates_in_any_pose(seed):
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.04, 0.12, 3)
    toward = rng.choice([-1.0, 1.0], 3) * rng.uniform(0.3, 1.0, 3)  # three faces are seen
    points, normals = seen_box(size, toward, rng)
    pose = make_pose(random_rotation(rng), rng.normal(0, 0.3, 3))
    rotation, center = pose[:3, :3], pose[:3, 3]
    axis = RotationSymmetry(unit(rng.normal(size=3)), [9, 9, 9])
    found, _ = candidate_planes(NOTHING, axis, moved(pose, points), normals @ rotation.T, None)
    for axis in rotation.T:
        assert has_plane(found, axis, center)


def test_two_seen_faces_of_a_standing_box_suffice_for_its_upright_planes():
    rng = np.random.default_rng(0)
    points, normals = seen_box(np.array([0.05, 0.08, 0.1]), [0.0, -0.7, 0.7], rng)
    table = Plane(np.array([0, 0, 1.0]), 0.05)
    found, _ = candidate_planes(NOTHING, UPRIGHT, points, normals, table)
    for axis in np.eye(3):
        assert has_plane(found, axis, np.zeros(3))


def test_a_plane_that_shape_and_network_name_is_one_candidate_of_both():
    size = np.array([0.05, 0.08, 0.1])
    points, normals = seen_box(size, [0.4, -0.7, 0.7], np.random.default_rng(0))
    named = SymmetrySlots(NOTHING.probability, np.zeros((5, 3)), NOTHING.direction.copy())
    named.direction[0] = [1.0, 0.0, 0.0]
    seen = named, UPRIGHT, points, normals, Plane(np.array([0, 0, 1.0]), 0.05)
    both, sources = candidate_planes(*seen)
    middle = [k for k, p in enumerate(both) if has_plane([p], [1.0, 0.0, 0.0], np.zeros(3))]
    assert NETWORK | SHAPE in sources[middle]
    assert set(sources) == {NETWORK, SHAPE, NETWORK | SHAPE}
    for source in (NETWORK, SHAPE):
        planes, only = candidate_planes(*seen, source)
        assert set(only) == {source}
        assert len(planes) < len(both)
        assert has_plane(planes, [1.0, 0.0, 0.0], np.zeros(3))
    assert not has_plane(planes, NOTHING.direction[1], np.zeros(3), degrees=1.0)


def test_the_axis_gives_the_middle_of_half_hidden_objects():
    points, normals = seen_box(
        np.array([0.05, 0.08, 0.1]), [0.0, -0.7, 0.7], np.random.default_rng(2)
    )
    seen = points[:, 0] > 0.0
    table = Plane(np.array([0, 0, 1.0]), 0.05)
    for point, known in (([0, 0, 0], True), ([9, 9, 9], False)):
        axis = RotationSymmetry([0, 0, 1], point)
        found, _ = candidate_planes(NOTHING, axis, points[seen], normals[seen], table)
        assert has_plane(found, [1.0, 0.0, 0.0], np.zeros(3)) == known


def test_the_first_of_nearly_equal_planes_stays():
    plane = ReflectionSymmetry([1, 0, 0], [0, 0, 0])
    near = ReflectionSymmetry(unit([1, 0.1, 0]), [0.002, 0, 0])
    aside = ReflectionSymmetry([1, 0, 0], [0.02, 0, 0])
    across = ReflectionSymmetry([0, 1, 0], [0, 0, 0])
    bits = np.array([1, 2, 1, 1])
    kept, sources = merged_planes([plane, near, aside, across], bits, np.radians(8), 0.004)
    assert (kept, sources.tolist()) == ([plane, aside, across], [3, 1, 1])
    kept, _ = merged_planes([near, plane, aside, across], bits, np.radians(25), np.inf)
    assert kept == [near, across]


@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 12),
    st.floats(0.1, 1.5),
    st.sampled_from([0.01, 0.1, np.inf]),
    st.integers(0, 10_000),
)
def test_a_plane_is_kept_unless_a_kept_plane_is_close_to_it(count, angle, offset, seed):
    rng = np.random.default_rng(seed)
    normals, points = unit(rng.normal(size=(count, 3))), rng.normal(0, 0.1, (count, 3))
    planes = [ReflectionSymmetry(*each) for each in zip(normals, points, strict=True)]
    kept = []
    for plane in planes:
        if not any(
            abs(float(plane.normal @ before.normal)) > np.cos(angle)
            and abs(float((plane.point - before.point) @ before.normal)) < offset
            for before in kept
        ):
            kept.append(plane)
    found, _ = merged_planes(planes, np.ones(len(planes), np.int64), angle, offset)
    assert [id(plane) for plane in found] == [id(plane) for plane in kept]
