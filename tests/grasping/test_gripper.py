"""Grippers as boxes, and their files."""

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipelines.errors import FormatError, SymgraspError, UnknownNameError, ValueRangeError
from pipelines.grasp_files.gripper_files import GRIPPERS, gripper_digest, load_gripper, preset_names


def test_every_preset_loads_under_its_own_name():
    assert set(preset_names()) == {"rg2", "robotiq_2f85", "franka"}
    for name in preset_names():
        assert load_gripper(name).name == name


def test_the_fingers_leave_the_opening_free_and_reach_past_the_contacts():
    gripper = load_gripper("rg2")
    left, right, palm = gripper.boxes(0.05)
    assert_allclose(right[0, 1] - left[1, 1], gripper.opening(0.05))
    assert_allclose(left[1, 0], gripper.tip_reach)
    assert_allclose(palm[1, 0], left[0, 0])


@pytest.mark.parametrize("name", preset_names())
def test_fingers_and_palm_are_as_large_as_the_file_says_and_centred(name):
    gripper = load_gripper(name)
    boxes = gripper.boxes(0.05)
    finger = gripper.finger_length, gripper.finger_thickness, gripper.finger_height
    open_fingers = gripper.opening(0.05) + 2 * gripper.finger_thickness
    palm = gripper.palm_depth, max(gripper.palm_width, open_fingers), gripper.palm_height
    assert_allclose(boxes[:, 1] - boxes[:, 0], [finger, finger, palm])
    middle = boxes.mean(axis=1)[:, 1:]
    beside = (gripper.opening(0.05) + gripper.finger_thickness) / 2
    assert_allclose(middle, [[-beside, 0.0], [beside, 0.0], [0.0, 0.0]], atol=1e-15)


@pytest.mark.parametrize(
    ("length", "depth"), [(0.05, 0.03), (0.035, 0.015), (0.02, 0.01), (0.1, 0.04)]
)
def test_graspnets_hand_has_fingers_as_long_within_its_depths(length, depth):
    gripper = replace(load_gripper("rg2"), finger_length=length)
    assert_allclose(gripper.graspnet_depth, depth)


def test_boxes_are_vectorised_over_widths():
    gripper = load_gripper("rg2")
    widths = np.array([0.01, 0.05, 0.09])
    assert_allclose(gripper.boxes(widths)[1], gripper.boxes(0.05))


def test_a_user_gripper_is_read_from_toml(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text((GRIPPERS / "rg2.toml").read_text().replace('"rg2"', '"mine"'))
    assert load_gripper(str(path)) == replace(load_gripper("rg2"), name="mine")


@pytest.mark.parametrize(
    ("written", "shown"), [("false", "False"), ("85", "85"), ("1", "1"), ("-0.01", "-0.01")]
)
def test_a_measure_that_is_no_length_below_a_metre_is_refused(written, shown, tmp_path):
    content = (GRIPPERS / "rg2.toml").read_text()
    measure = f"tip_reach = {written}"
    (tmp_path / "g.toml").write_text(re.sub(r"(?m)^tip_reach = .*", measure, content))
    expected = "a length in metres (millimetres / 1000), at least 0 and below 1"
    sentence = re.escape(f"tip_reach is {shown}; it must be {expected}")
    with pytest.raises(SymgraspError, match=sentence):
        load_gripper(str(tmp_path / "g.toml"))


def test_the_digest_covers_only_the_measures(tmp_path):
    content = (GRIPPERS / "rg2.toml").read_text()
    (tmp_path / "same.toml").write_text(content.replace('"rg2"', '"mine"'))
    (tmp_path / "other.toml").write_text(content.replace("0.110", "0.111"))
    same, other = (gripper_digest(str(tmp_path / f"{name}.toml")) for name in ("same", "other"))
    assert same == gripper_digest("rg2") != other


def test_wrong_gripper_files_are_refused_with_a_sentence(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('name = "mine"\n')
    with pytest.raises(FormatError, match=r"lacks .*max_opening"):
        load_gripper(str(path))
    path.write_text((GRIPPERS / "rg2.toml").read_text() + "colour = 3\n")
    with pytest.raises(FormatError, match="has the unknown colour; the keys"):
        load_gripper(str(path))
    path.write_text((GRIPPERS / "rg2.toml").read_text().replace("clearance", "clearence"))
    with pytest.raises(FormatError, match="lacks clearance and has the unknown clearence"):
        load_gripper(str(path))
    with pytest.raises(SymgraspError, match=r"missing\.toml does not exist"):
        load_gripper(str(tmp_path / "missing.toml"))
    path.write_text("name = ")
    with pytest.raises(FormatError, match="TOML"):
        load_gripper(str(path))
    with pytest.raises(UnknownNameError, match="rg2"):
        load_gripper("no-such-gripper")
    with pytest.raises(ValueRangeError, match="finger_length"):
        replace(load_gripper("rg2"), finger_length=-1.0)


def test_lengths_may_be_numbers_of_numpy():
    gripper = load_gripper("rg2")
    given = replace(gripper, max_opening=np.float32(0.125), palm_depth=np.int64(0))
    assert given == replace(gripper, max_opening=0.125, palm_depth=0.0)
    assert (type(given.max_opening), type(given.palm_depth)) == (float, int)
    with pytest.raises(ValueRangeError, match="palm_depth is 40"):
        replace(gripper, palm_depth=np.float32(40.0))


def test_an_approach_path_may_be_longer_than_any_gripper():
    gripper = load_gripper("rg2")
    assert_allclose(gripper.swept(2.0).palm_depth, gripper.palm_depth + 2.0)
    assert load_gripper("rg2") == gripper
