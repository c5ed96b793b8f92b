"""Copies of grasps across symmetries: laws that hold for every grasp and every symmetry."""

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.distance import cdist

from pipelines.errors import ValueRangeError
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, SphereSymmetry
from pipelines.geometry.transforms import (
    make_pose,
    random_rotation,
    rotation_about,
    transform_points,
    unit,
)
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.symmetrize import (
    MAX_COPIES,
    MAX_GROUP,
    copies_under,
    distinct,
    image,
    isometries,
    symmetry_group,
)

seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=25, deadline=None)
MERGE = 0.001


def random_grasps(rng, count=12):
    rotation = np.stack([random_rotation(rng) for _ in range(count)])
    return GraspPoses(rotation, rng.uniform(-0.1, 0.1, (count, 3)), rng.uniform(0.01, 0.1, count))


def random_plane(rng):
    return ReflectionSymmetry(unit(rng.normal(size=3)), rng.uniform(-0.05, 0.05, 3))


def random_symmetry(rng, kind):
    direction, point = unit(rng.normal(size=3)), rng.uniform(-0.05, 0.05, 3)
    made = {
        "reflection": ReflectionSymmetry(direction, point),
        "rotation": RotationSymmetry(direction, point),
        "threefold": RotationSymmetry(direction, point, order=3),
        "sphere": SphereSymmetry(point),
    }
    return made[kind]


kinds = st.sampled_from(["reflection", "rotation", "threefold", "sphere"])


def symmetrized(grasps, symmetry):
    """Return `grasps` and all their copies, and the original of each."""
    group = isometries(symmetry, 12)
    rng, most = np.random.default_rng(0), len(group) * len(grasps)
    copies, origin = copies_under(grasps, group, merge_distance=MERGE, max_copies=most, rng=rng)
    return GraspPoses.concatenate([grasps, copies]), np.r_[np.arange(len(grasps)), origin]


def mirrored_in(grasps, plane):
    """Return `grasps` mirrored in `plane`."""
    return image(grasps, isometries(plane, 1)[0])


def images(grasps, symmetry):
    """Return the copies of `grasps` under `symmetry`, one set for each isometry."""
    return [image(grasps, each) for each in isometries(symmetry, 12)]


@few
@given(seeds)
def test_mirrored_contacts_are_the_mirror_images_with_fingers_swapped(seed):
    rng = np.random.default_rng(seed)
    grasps, plane = random_grasps(rng), random_plane(rng)
    mirrored = mirrored_in(grasps, plane).contacts
    assert_allclose(mirrored, plane.counterpart(grasps.contacts)[:, ::-1], atol=1e-12)


@few
@given(seeds)
def test_a_mirrored_gripper_approaches_along_the_mirrored_approach(seed):
    rng = np.random.default_rng(seed)
    grasps, plane = random_grasps(rng), random_plane(rng)
    mirrored = mirrored_in(grasps, plane)
    assert_allclose(mirrored.approach, plane.mirror_vectors(grasps.approach), atol=1e-12)


@few
@given(seeds, kinds)
def test_every_copy_is_a_rotation_with_determinant_one(seed, kind):
    rng = np.random.default_rng(seed)
    copies = images(random_grasps(rng), random_symmetry(rng, kind))
    assert_allclose(np.linalg.det(GraspPoses.concatenate(copies).rotation), 1.0)


@few
@given(seeds)
def test_mirroring_twice_gives_the_grasps_back(seed):
    rng = np.random.default_rng(seed)
    grasps, plane = random_grasps(rng), random_plane(rng)
    back = mirrored_in(mirrored_in(grasps, plane), plane)
    assert_allclose(back.rotation, grasps.rotation, atol=1e-12)
    assert_allclose(back.translation, grasps.translation, atol=1e-12)


@few
@given(seeds)
def test_turned_contacts_are_the_turned_contacts(seed):
    rng = np.random.default_rng(seed)
    grasps, axis = random_grasps(rng), random_symmetry(rng, "rotation")
    angles = 2.0 * np.pi * np.arange(1, 12) / 12
    for angle, copy in zip(angles, images(grasps, axis), strict=True):
        assert_allclose(copy.contacts, axis.turn(grasps.contacts, angle), atol=1e-12)


@few
@given(seeds, kinds)
def test_symmetrizing_twice_adds_nothing(seed, kind):
    rng = np.random.default_rng(seed)
    grasps, symmetry = random_grasps(rng), random_symmetry(rng, kind)
    once, _ = symmetrized(grasps, symmetry)
    twice, origin = symmetrized(once, symmetry)
    assert len(twice) == len(once) > len(grasps)
    assert_allclose(origin, np.arange(len(once)))


@few
@given(seeds, kinds)
def test_each_copy_names_an_original_of_the_same_width(seed, kind):
    rng = np.random.default_rng(seed)
    grasps, symmetry = random_grasps(rng), random_symmetry(rng, kind)
    copies, origin = symmetrized(grasps, symmetry)
    assert_allclose(copies.width, grasps.width[origin], atol=1e-12)
    assert_allclose(origin[: len(grasps)], np.arange(len(grasps)))


def test_a_grasp_across_the_plane_is_its_own_mirror_image():
    contacts = np.array([[[-0.02, 0.0, 0.0], [0.02, 0.0, 0.0]]])
    grasps = GraspPoses.from_contacts(contacts, np.array([[0.0, 0.0, 1.0]]))
    plane = ReflectionSymmetry(np.array([1.0, 0.0, 0.0]), np.zeros(3))
    assert len(symmetrized(grasps, plane)[0]) == 1


def test_a_pair_across_the_axis_is_counted_once_per_half_turn():
    contacts = np.array([[[-0.02, 0.0, 0.0], [0.02, 0.0, 0.0]]])
    grasps = GraspPoses.from_contacts(contacts, np.array([[0.0, 0.0, 1.0]]))
    axis = RotationSymmetry(np.array([0.0, 0.0, 1.0]), np.zeros(3))
    assert len(symmetrized(grasps, axis)[0]) == 6  # opposite ones of 12 turns swap fingers


def test_the_copies_on_a_ball_reach_all_its_sides():
    contacts = np.array([[[-0.03, 0.001, 0.004], [0.03, 0.001, 0.004]]])
    grasps = GraspPoses.from_contacts(contacts, np.array([[0.0, 0.3, 1.0]]))
    copies, _ = symmetrized(grasps, SphereSymmetry(np.zeros(3)))
    directions = unit(copies.contacts.reshape(-1, 3))
    spread = np.linalg.eigvalsh(directions.T @ directions / len(directions))
    assert_allclose(spread, 1.0 / 3.0, atol=1e-6)


def test_distinct_keeps_the_first_of_each_pair_whatever_the_finger_order():
    pair = np.array([[0.0101, 0.0204, 0.0303], [0.0507, 0.0404, 0.0101]])
    contacts = np.stack([pair, pair[::-1], pair + 0.05])
    grasps = GraspPoses.from_contacts(contacts, np.tile([0.0, 0.0, 1.0], (3, 1)))
    assert_allclose(distinct(grasps, 0.002), [0, 2])


def test_no_grasps_have_no_copies():
    for kind in ("reflection", "rotation", "sphere"):
        symmetry = random_symmetry(np.random.default_rng(0), kind)
        assert len(symmetrized(GraspPoses.empty(), symmetry)[0]) == 0


X, Y, Z = np.eye(3)
ORIGIN = np.zeros(3)
# Symmetries, and the number of transforms of their group without the identity.
GROUPS = {
    "nothing": ([], 0),
    "box": ([ReflectionSymmetry(normal, ORIGIN) for normal in (X, Y, Z)], 7),
    "two planes at 60 degrees": (
        [ReflectionSymmetry(X, ORIGIN), ReflectionSymmetry([0.5, np.sqrt(0.75), 0.0], ORIGIN)],
        5,
    ),
    "square prism": (
        [
            RotationSymmetry(Z, ORIGIN, order=4),
            ReflectionSymmetry(X, ORIGIN),
            ReflectionSymmetry(Z, ORIGIN),
        ],
        15,
    ),
    "cup": ([RotationSymmetry(Z, ORIGIN)], 35),
    "can": ([RotationSymmetry(Z, ORIGIN), ReflectionSymmetry(Z, ORIGIN)], 71),
    "can with a plane along its axis": (
        [
            RotationSymmetry(Z, ORIGIN),
            ReflectionSymmetry(Z, ORIGIN),
            ReflectionSymmetry([np.cos(0.3), np.sin(0.3), 0.0], ORIGIN),
        ],
        143,
    ),
    "ball": ([SphereSymmetry(ORIGIN), ReflectionSymmetry(unit([1.0, 2.0, 3.0]), ORIGIN)], 59),
}
groups = st.sampled_from(sorted(GROUPS))


def posed(symmetries, rng):
    T = make_pose(random_rotation(rng), rng.uniform(-0.05, 0.05, 3))
    return [symmetry.transformed(T) for symmetry in symmetries]


@settings(max_examples=8, deadline=None)
@given(seeds, groups)
def test_a_group_has_every_product_and_no_transform_twice(seed, name):
    symmetries, size = GROUPS[name]
    group = symmetry_group(posed(symmetries, np.random.default_rng(seed)), 36)
    assert len(group) == size
    whole = np.concatenate([np.eye(4)[None], group])
    products = (whole[:, None] @ whole[None]).reshape(-1, 16)
    gaps = np.abs(products[:, None] - whole.reshape(1, -1, 16)).max(axis=2)
    assert ((gaps < 1e-9).sum(axis=1) == 1).all()


@pytest.mark.parametrize("count", [0, MAX_COPIES + 1, 360])
def test_more_copies_per_turn_than_a_group_may_hold_are_refused(count):
    with pytest.raises(ValueRangeError, match=f"copies per turn is {count}"):
        symmetry_group([RotationSymmetry([0, 0, 1], [0, 0, 0])], count)


def test_the_largest_group_is_complete_with_planes_along_and_across_the_axis():
    planes = [ReflectionSymmetry(normal, [0, 0, 0]) for normal in ([0, 0, 1], [1, 0, 0])]
    group = symmetry_group([RotationSymmetry([0, 0, 1], [0, 0, 0]), *planes], MAX_COPIES)
    assert len(group) == 4 * MAX_COPIES - 1
    assert MAX_COPIES == 72  # the limit of the command's option


def nearest_copies(grasps, group):
    """The least distance of contact pairs among all copies, fingers in either order."""
    pairs = [grasps.contacts, *(transform_points(T, grasps.contacts) for T in group)]
    both = [np.concatenate(pairs)[:, order].reshape(-1, 6) for order in ([0, 1], [1, 0])]
    gaps = np.minimum(cdist(both[0], both[0]), cdist(both[0], both[1]))
    return gaps[np.triu_indices(len(gaps), 1)].min()


@few
@given(seeds, groups)
def test_copies_under_several_symmetries_are_complete_the_first_time(seed, name):
    rng = np.random.default_rng(seed)
    group, grasps = symmetry_group(posed(GROUPS[name][0], rng), 12), random_grasps(rng, 3)
    assume(nearest_copies(grasps, group) > MERGE)  # a grasp near a mirror plane is its own copy

    def copies_of(some):
        return copies_under(some, group, merge_distance=MERGE, max_copies=10**6, rng=rng)[0]

    once = GraspPoses.concatenate([grasps, copies_of(grasps)])
    assert len(once) == len(grasps) * (len(group) + 1)
    assert len(copies_of(once)) == 0


@few
@given(seeds, groups)
def test_contacts_of_images_are_images_of_contacts(seed, name):
    rng = np.random.default_rng(seed)
    grasps = random_grasps(rng)
    for isometry in symmetry_group(posed(GROUPS[name][0], rng), 12):
        copies, expected = image(grasps, isometry), transform_points(isometry, grasps.contacts)
        swapped = np.linalg.det(isometry[:3, :3]) < 0
        assert_allclose(copies.contacts, expected[:, ::-1] if swapped else expected, atol=1e-12)
        assert_allclose(np.linalg.det(copies.rotation), 1.0)
        approach = grasps.approach @ isometry[:3, :3].T
        assert_allclose(copies.approach, approach, atol=1e-12)


@few
@given(seeds, st.sampled_from(["box", "square prism", "two planes at 60 degrees"]))
@example(245, "two planes at 60 degrees")
def test_measured_symmetries_make_the_group_of_the_true_ones(seed, name):
    rng = np.random.default_rng(seed)
    symmetries, size = GROUPS[name]
    turn = unit(rng.normal(size=(len(symmetries), 3)))
    poses = [rotation_about(axis, np.deg2rad(0.5)) for axis in turn]
    measured = [
        each.transformed(make_pose(pose, rng.normal(size=3) * 0.0005))
        for each, pose in zip(symmetries, poses, strict=True)
    ]
    assert len(symmetry_group(measured, 36)) == size


def test_the_group_of_contradicting_symmetries_is_finite():
    rng = np.random.default_rng(0)
    wild = [RotationSymmetry(unit(rng.normal(size=3)), ORIGIN) for _ in range(3)]
    assert len(symmetry_group(wild, 36)) == MAX_GROUP


def test_a_limited_number_of_copies_is_shared_evenly_by_transforms_and_grasps():
    rng = np.random.default_rng(0)
    grasps = random_grasps(rng, 2000)
    group = symmetry_group(GROUPS["box"][0], 36)
    few_copies, origin = copies_under(
        grasps, group, merge_distance=1e-9, max_copies=7 * 500, rng=np.random.default_rng(1)
    )
    assert len(few_copies) == 7 * 500
    sides = np.array([image(grasps[:1], T).translation[0] > 0 for T in group])
    per_side = [
        ((few_copies.translation > 0) == (grasps.translation[origin] > 0) ^ flip).all(axis=1).sum()
        for flip in np.unique(sides ^ (grasps.translation[:1] > 0), axis=0)
    ]
    assert_array_equal(per_side, 500)
    # About half the copies are of the first half of the grasps: four standard deviations.
    assert abs((origin < 1000).mean() - 0.5) < 4 * 0.5 / np.sqrt(3500)


def test_without_symmetries_there_are_no_copies():
    grasps = random_grasps(np.random.default_rng(0))
    group = symmetry_group([], 36)
    rng = np.random.default_rng(0)
    assert len(copies_under(grasps, group, merge_distance=MERGE, max_copies=9, rng=rng)[0]) == 0


def test_of_more_transforms_than_copies_some_are_drawn():
    grasps = random_grasps(np.random.default_rng(0), 3)
    group = symmetry_group(GROUPS["box"][0], 36)
    copies, origin = copies_under(
        grasps, group, merge_distance=1e-9, max_copies=5, rng=np.random.default_rng(1)
    )
    assert len(copies) == len(origin) == 5 < len(group)
