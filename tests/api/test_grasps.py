"""Grasps of one frame: their order, parts, poses, regions and symmetries."""

from dataclasses import FrozenInstanceError, fields, replace

import numpy as np
import pytest

from pipelines.errors import SymgraspError, UnknownNameError
from pipelines.grasp_files.exports.export_poses import ExportGripper
from pipelines.grasp_files.exports.grasp_exports import FrameGrasps
from pipelines.grasp_files.grasps_tables import FrameResult, GraspTable
from symgrasp import Grasp, Grasps
from symgrasp.grasps import ordered_grasps
from tests.grasp_files.exports.gripper_toys import CAMERA, random_gripper, random_result

RNG = np.random.default_rng(5)
GRIPPER = random_gripper(RNG)
RESULT = random_result(RNG, 12)
SHUFFLED = replace(
    RESULT,
    grasps=replace(
        RESULT.grasps,
        rank_score=RNG.permutation(RESULT.grasps.rank_score),
        rank_in_frame=np.zeros(0),  # follows from the scores
    ),
)
GRASPS = ordered_grasps(SHUFFLED, GRIPPER)


def test_every_column_of_the_file_but_the_frame_is_an_attribute():
    columns = {name for name in GraspTable.SPEC if name != "frame"}
    assert columns <= {field.name for field in fields(Grasps)}


def test_the_best_grasp_of_all_regions_comes_first():
    assert len(GRASPS) == len(SHUFFLED.grasps)
    assert (np.diff(GRASPS.rank_score) <= 0).all()
    assert GRASPS.rank_in_frame.tolist() == list(range(12))
    assert GRASPS.best.rank_in_frame == 0
    assert GRASPS.best.rank_score == SHUFFLED.grasps.rank_score.max()
    for grasp in GRASPS:
        (place,) = np.flatnonzero(SHUFFLED.grasps.rank_score == np.float32(grasp.rank_score))
        np.testing.assert_array_equal(grasp.rotation, SHUFFLED.grasps.rotation[place])
        assert grasp.region == SHUFFLED.grasps.region[place]


def test_grasps_that_tie_stay_in_the_order_of_the_file():
    columns = {"rank_score": np.ones(12), "rank_in_frame": np.zeros(0)}
    tied = replace(RESULT, grasps=replace(RESULT.grasps, **columns))
    np.testing.assert_array_equal(ordered_grasps(tied, GRIPPER).width, RESULT.grasps.width)


def test_a_number_gives_one_grasp_and_a_slice_or_array_gives_grasps():
    assert GRASPS[2].width == GRASPS.width[2]
    assert GRASPS[-1].width == GRASPS.width[-1]
    assert GRASPS[np.int64(1)].width == GRASPS.width[1]
    assert isinstance(GRASPS[np.array(1)], Grasp)
    np.testing.assert_array_equal(GRASPS[1:4].translation, GRASPS.translation[1:4])
    np.testing.assert_array_equal(GRASPS[GRASPS.is_best].width, GRASPS.width[GRASPS.is_best])
    np.testing.assert_array_equal(GRASPS[[3, 1]].width, GRASPS.width[[3, 1]])
    assert GRASPS[1:4].regions is GRASPS.regions
    with pytest.raises(IndexError):
        GRASPS[12]


def test_grasps_are_read_only():
    with pytest.raises(FrozenInstanceError):
        GRASPS.width = np.zeros(12)
    for some in (GRASPS, GRASPS[1:3], GRASPS[[2, 0]], GRASPS[GRASPS.is_best]):
        with pytest.raises(ValueError, match="read-only"):
            some.width[0] = 0.0
    with pytest.raises(ValueError, match="read-only"):
        GRASPS.regions[0].mask[0, 0] = True
    assert SHUFFLED.grasps.width.flags.writeable


def test_poses_and_openings_are_those_of_an_export():
    hand = ExportGripper(GRIPPER, GRIPPER.base_to_contacts, "toy")
    wide = replace(GRIPPER, max_opening=0.2)
    exported = FrameGrasps.of(SHUFFLED, 0, replace(hand, model=wide))
    np.testing.assert_allclose(GRASPS.poses(), exported.poses, atol=1e-12)
    np.testing.assert_allclose(GRASPS.opening, exported.opening, atol=1e-12)
    np.testing.assert_array_equal(GRASPS[4].pose(), GRASPS.poses()[4])
    assert GRASPS[4].opening == GRASPS.opening[4]


def test_both_conventions_approach_along_z_and_close_along_their_named_axis():
    for convention, column in (("closing_y", 1), ("closing_x", 0)):
        poses = GRASPS.poses(convention)
        np.testing.assert_allclose(poses[:, :3, 2], GRASPS.rotation[:, :, 0], atol=1e-6)
        np.testing.assert_allclose(poses[:, :3, column], GRASPS.rotation[:, :, 1], atol=1e-6)
        np.testing.assert_allclose(np.linalg.det(poses[:, :3, :3]), 1.0, atol=1e-12)
    with pytest.raises(UnknownNameError, match="closing_x, closing_y"):
        GRASPS.poses("z")


def test_a_frame_without_grasps_gives_the_reason():
    empty = ordered_grasps(FrameResult("f", "empty", "nothing stands out", CAMERA), GRIPPER)
    assert (len(empty), list(empty), empty.poses().shape) == (0, [], (0, 4, 4))
    with pytest.raises(SymgraspError, match="there is no grasp: nothing stands out"):
        _ = empty.best
    with pytest.raises(SymgraspError, match="all were left out"):
        _ = GRASPS[:0].best


def frame_with_symmetries():
    point, direction = np.full((2, 5, 3), np.nan), np.full((2, 5, 3), np.nan)
    confidence = np.zeros((2, 5))
    confidence[0, [1, 3]], confidence[1, 4] = (0.4, 0.9), 0.8
    point[0, [1, 3]], point[1, 4] = (1, 2, 3), (4, 5, 6)
    direction[0, [1, 3]] = (0, 0, 1)
    regions = replace(
        random_result(RNG, 0, regions=2).regions,
        symmetry_confidence=confidence,
        existence=confidence / 2,
        symmetry_point=point,
        symmetry_direction=direction,
    )
    table = random_result(RNG, 3, regions=1).grasps
    slots = replace(table, region=np.array([0, 0, 1]), symmetry_slot=np.array([3, -1, 4]))
    return ordered_grasps(FrameResult("f", "ok", "", CAMERA, 0.0, regions, slots), GRIPPER)


def test_regions_have_their_symmetries_most_confident_first():
    grasps = frame_with_symmetries()
    first, second = grasps.regions
    assert [(s.kind, s.slot, s.region) for s in first.symmetries] == [
        ("rotation", 3, 0),
        ("reflection", 1, 0),
    ]
    assert [s.confidence for s in first.symmetries] == pytest.approx([0.9, 0.4])
    assert [s.existence for s in first.symmetries] == pytest.approx([0.45, 0.2])
    (sphere,) = second.symmetries
    assert (sphere.kind, sphere.region) == ("sphere", 1)
    assert np.isnan(sphere.direction).all()
    assert grasps.symmetries == first.symmetries + second.symmetries


def test_a_grasp_knows_the_symmetry_that_gave_its_second_contact():
    grasps = frame_with_symmetries()
    kinds = [grasp.symmetry and grasp.symmetry.kind for grasp in grasps]
    assert kinds == ["rotation", None, "sphere"]


def test_regions_have_their_masks():
    for place, region in enumerate(GRASPS.regions):
        np.testing.assert_array_equal(region.mask, np.eye(12, 16, place, dtype=bool))
        assert region.instance is None


def test_regions_from_masks_have_the_numbers_of_the_masks():
    regions = replace(RESULT.regions, instance=[7, 0, -1])
    grasps = ordered_grasps(replace(RESULT, regions=regions), GRIPPER)
    assert [region.instance for region in grasps.regions] == [7, 0, None]


def test_without_a_grasp_that_is_left_the_reason_is_not_the_note_of_a_frame_with_grasps():
    noted = ordered_grasps(replace(RESULT, message="1 of 4 instances were dropped"), GRIPPER)
    with pytest.raises(SymgraspError, match="there is no grasp: all were left out"):
        _ = noted[noted.width > 9.0].best


def test_grasps_and_regions_are_printed_as_one_line():
    assert repr(GRASPS).startswith("Grasps(12 in 3 regions, best rank_score ")
    assert repr(GRASPS[[]]) == "Grasps(0 in 3 regions: all were left out)"
    assert repr(frame_with_symmetries().regions[0]).endswith("rotation 0.90, reflection 0.40)")
