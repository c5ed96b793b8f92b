"""The scene that a page draws, against the content of the file."""

import json
from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.configs import ViewConfig
from pipelines.grasp_files.grasps_tables import GraspTable, RegionTable
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.pictures.grasp_page.cloud import _stride
from pipelines.pictures.grasp_page.scene import frame_scene, places_in_region, region_symmetries
from tests.geometry.tabletops import CAMERA
from tests.pictures.grasp_page.toys import decoded, toy_frame, toy_result

GRIPPER = load_gripper("franka")
FRAME, INDEX = toy_frame()
RESULT = toy_result(FRAME, INDEX)
SCENE = frame_scene(FRAME, RESULT, GRIPPER, ViewConfig())


def array(name: str) -> np.ndarray:
    return decoded(SCENE["arrays"][name])


def test_grasps_are_kept_to_the_last_bit():
    table = RESULT.grasps
    for name in ("rotation", "translation", "contacts", "width", "rank_score", "affordance"):
        assert_array_equal(array(name), getattr(table, name))
    assert_array_equal(array("grasp_region"), table.region)
    assert_array_equal(array("symmetry_slot"), table.symmetry_slot)
    assert SCENE["sources"] == list(table.source)


def test_the_hand_has_the_measures_of_its_gripper():
    boxes = array("boxes").astype(float)
    inner = boxes[:, 1, 0, 1] - boxes[:, 0, 1, 1]
    assert_allclose(inner, RESULT.grasps.width + 2 * GRIPPER.clearance, atol=1e-7)
    size = boxes[:, :, 1] - boxes[:, :, 0]
    fingers = (GRIPPER.finger_length, GRIPPER.finger_thickness, GRIPPER.finger_height)
    assert_allclose(size[:, :2], np.broadcast_to(fingers, size[:, :2].shape), atol=1e-7)
    assert_allclose(size[:, 2, 0], GRIPPER.palm_depth, atol=1e-7)


def test_pixels_of_a_region_have_its_number():
    assert_array_equal(array("region"), np.where(INDEX >= 0, INDEX + 1, 0))


def test_the_table_is_found_and_up_points_to_the_camera():
    assert SCENE["has_table"]
    up = np.array(SCENE["up"])
    assert_allclose(np.linalg.norm(up), 1.0)
    assert up @ SCENE["focus"]["place"] < 0


def test_symmetries_are_drawn_at_their_place_near_their_region():
    points = CAMERA.backproject(FRAME.depth)
    inside = points[(INDEX == 0) & (FRAME.depth > 0)]
    found = {each["slot"]: each for each in region_symmetries(RESULT.regions, 0, inside)}
    assert {slot: each["kind"] for slot, each in found.items()} == {
        0: "plane", 1: "plane", 3: "axis", 4: "sphere"
    }  # fmt: skip
    table = RESULT.regions
    for slot in (0, 1):
        off = np.array(found[slot]["place"]) - table.symmetry_point[0, slot]
        assert abs(off @ table.symmetry_direction[0, slot]) < 1e-6
    off = np.array(found[3]["place"]) - table.symmetry_point[0, 3]
    assert np.linalg.norm(np.cross(off, table.symmetry_direction[0, 3])) < 1e-6
    assert_allclose(found[4]["place"], table.symmetry_point[0, 4], atol=1e-6)
    middle = np.median(inside, axis=0)
    assert all(np.linalg.norm(np.array(each["place"]) - middle) < 0.05 for each in found.values())
    assert found[0]["confidence"] == np.float32(0.9)
    assert region_symmetries(table, 0, np.zeros((0, 3))) == []


def test_ranks_in_a_region_start_with_the_best_grasp_then_follow_the_score():
    table = toy_result(FRAME, INDEX, grasps=6).grasps
    score = np.array([0.2, 0.9, 0.5, 0.1, 0.3, 0.2])
    table = replace(table, rank_score=score, is_best=np.array([1, 0, 0, 0, 1, 0], bool))
    assert_array_equal(table.region, [0, 0, 0, 1, 1, 1])
    assert_array_equal(places_in_region(table), [0, 1, 2, 2, 0, 1])
    assert len(places_in_region(GraspTable.empty())) == 0


def test_the_first_grasps_of_every_region_are_kept_of_too_many():
    scene = frame_scene(FRAME, RESULT, GRIPPER, ViewConfig(max_grasps=3))
    rows = decoded(scene["arrays"]["row"])
    places = places_in_region(RESULT.grasps)
    assert scene["left_out"] == 2
    assert_array_equal(np.sort(places[rows]), np.sort(places)[:3])
    assert_array_equal(decoded(scene["arrays"]["translation"]), RESULT.grasps.translation[rows])


def test_a_frame_without_grasps_or_with_missing_numbers_can_be_written():
    empty = replace(RESULT, grasps=GraspTable.empty(), regions=RegionTable.empty())
    assert json.dumps(frame_scene(FRAME, empty, GRIPPER, ViewConfig()), allow_nan=False)
    regions = replace(RESULT.regions, confidence=np.full(2, np.nan))
    grasps = replace(RESULT.grasps, translation=np.full((5, 3), np.nan))
    odd = replace(RESULT, regions=regions, grasps=grasps)
    assert json.dumps(frame_scene(FRAME, odd, GRIPPER, ViewConfig()), allow_nan=False)


def test_depth_with_holes_next_to_most_pixels_is_drawn_as_infer_fills_it():
    sparse = np.zeros_like(FRAME.depth)
    sparse[1::2, 1::2] = FRAME.depth[1::2, 1::2]  # no depth where every second pixel is kept
    config = ViewConfig(max_pixels=sparse.size // 4)
    scene = frame_scene(replace(FRAME, depth=sparse), RESULT, GRIPPER, config)
    assert scene["camera"]["columns"] == CAMERA.width // 2
    whole = frame_scene(FRAME, RESULT, GRIPPER, config)
    measured = [(decoded(each["arrays"]["depth"]) > 0).mean() for each in (scene, whole)]
    assert measured[0] > 0.95 * measured[1]
    assert scene["has_table"]
    for each, same in zip(scene["regions"], whole["regions"], strict=True):
        assert len(each["symmetries"]) == len(same["symmetries"]) > 0


def test_no_pixel_of_the_usual_cameras_is_left_out():
    for width, height in ((640, 480), (848, 480)):
        assert _stride((height, width), ViewConfig().max_pixels) == 1
