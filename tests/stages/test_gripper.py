"""`gripper`: measures of a URDF, and checks of a gripper's file."""

from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from pipelines import gripper
from pipelines.configs import GripperConfig
from pipelines.errors import FormatError, SymgraspError
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.storage.images import read_image
from symgrasp_cli.app import app

# As panda_hand: fingers slide along y, z is the approach; one finger is turned by half a turn.
URDF = """<robot name="toy_hand">
  <link name="hand"><collision><origin xyz="0 0 0.03"/>
    <geometry><box size="0.05 0.2 0.06"/></geometry></collision></link>
  <link name="left"><collision><origin xyz="0 0.006 0.025"/>
    <geometry><box size="0.02 0.012 0.05"/></geometry></collision></link>
  <link name="right"><collision><origin xyz="0 0.006 0.025"/>
    <geometry><box size="0.02 0.012 0.05"/></geometry></collision></link>
  <joint name="slide_left" type="prismatic"><parent link="hand"/><child link="left"/>
    <origin xyz="0 0 0.06"/><axis xyz="0 1 0"/><limit lower="0" upper="0.04"/></joint>
  <joint name="slide_right" type="prismatic"><parent link="hand"/><child link="right"/>
    <origin xyz="0 0 0.06" rpy="0 0 3.14159265359"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.04"/><mimic joint="slide_left"/></joint>
</robot>"""
EXPECTED = {
    "max_opening": 0.08,
    "finger_length": 0.05,
    "finger_thickness": 0.012,
    "finger_height": 0.02,
    "palm_depth": 0.06,
    "palm_width": 0.2,
    "palm_height": 0.05,
    "flange_to_tip": 0.11,
}


def measured(tmp_path, text=URDF, **config):
    return measured_with_notes(tmp_path, text, **config)[0]


def measured_with_notes(tmp_path, text=URDF, **config):
    (tmp_path / "g.urdf").write_text(text)
    return gripper.gripper_of(str(tmp_path / "g.urdf"), GripperConfig(**config))


def test_the_measures_equal_those_of_the_bodies(tmp_path):
    found = measured(tmp_path)
    assert found.name == "toy_hand"
    assert {key: getattr(found, key) for key in EXPECTED} == pytest.approx(EXPECTED, abs=1e-5)
    assert gripper.oddities_of(found) == []


def test_meshes_are_read_relative_to_the_file(tmp_path):
    (tmp_path / "meshes").mkdir()
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    text = "".join(f"v {0.025 * x} {0.1 * y} {0.03 * z}\n" for x, y, z in corners)
    (tmp_path / "meshes" / "hand.obj").write_text(f"{text}f 1 2 3\nf 6 7 8\nf 4 5 6\n")
    mesh = '<mesh filename="package://toy/meshes/hand.obj"/>'
    found = measured(tmp_path, URDF.replace('<box size="0.05 0.2 0.06"/>', mesh))
    assert found.palm_width == pytest.approx(0.2, abs=1e-5)
    with pytest.raises(FormatError, match="names a missing mesh"):
        measured(tmp_path, URDF.replace('<box size="0.05 0.2 0.06"/>', mesh.replace("hand", "x")))


THIRD_FINGER = """<link name="third"/><joint name="c" type="prismatic"><parent link="hand"/>
  <child link="third"/></joint></robot>"""


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("prismatic", "revolute", "has 0 sliding joints, and no link with just two of them"),
        ('link="hand"/><child link="right"', 'link="left"/><child link="right"', "no link with"),
        ("</robot>", THIRD_FINGER, "has 3 sliding joints, and no link with just two of them"),
        ('<parent link="hand"/>', '<parent link="palm"/>', "no link 'palm'; its links: hand"),
        ("<robot", "<!DOCTYPE r [<!ENTITY a 'b'>]><robot", "not XML"),
        ("</robot>", "", "not XML"),
        ('size="0.05 0.2 0.06"', 'size="0.05 wide 0.06"', "the value 'wide'; a number"),
        ('size="0.05 0.2 0.06"', 'size="0.05"', "the vector '0.05'; three numbers"),
        ('upper="0.04"', 'upper="0"', "measures of no gripper"),
        ('upper="0.04"', 'upper="inf"', "the value 'inf'; a number"),
        ("robot", "model", "describes no robot"),
        ('<child link="right"/>', '<child link="left"/>', "two parent joints"),
    ],
)
def test_a_urdf_without_a_parallel_gripper_is_reported_in_one_sentence(
    old, new, sentence, tmp_path
):
    with pytest.raises(FormatError, match=sentence):
        measured(tmp_path, URDF.replace(old, new))


def test_the_command_writes_a_file_that_infer_takes_and_a_picture(tmp_path):
    (tmp_path / "g.urdf").write_text(URDF)
    out = tmp_path / "mine.toml"
    words = ["gripper", "from-urdf", str(tmp_path / "g.urdf"), "--out", str(out)]
    assert CliRunner().invoke(app, words).exit_code == 0
    assert load_gripper(str(out)).max_opening == pytest.approx(0.08)
    picture = read_image(out.with_suffix(".png"))
    assert np.ptp(picture) > 100
    assert CliRunner().invoke(app, words).exit_code == 1  # file and picture exist
    checked = ["gripper", "check", str(out), "--picture", str(tmp_path / "again.png")]
    assert CliRunner().invoke(app, checked).exit_code == 0
    assert (tmp_path / "again.png").is_file()
    assert CliRunner().invoke(app, ["gripper", "from-urdf", str(out)]).exit_code == 2


def test_a_name_with_a_line_break_gives_a_file_that_can_be_read(tmp_path):
    source, out = tmp_path / "a\nb.urdf", tmp_path / "mine.toml"
    source.write_text(URDF.replace("toy_hand", "toy&#10;ha\\nd"))
    gripper.run(str(source), GripperConfig(), output=out)
    assert load_gripper(str(out)).name == "toyhand"


def test_the_same_command_completes_what_a_killed_run_left(tmp_path, monkeypatch):
    (tmp_path / "g.urdf").write_text(URDF)
    out, picture = tmp_path / "mine.toml", tmp_path / "mine.png"

    def killed(*_):
        raise KeyboardInterrupt

    def run():
        gripper.run(str(tmp_path / "g.urdf"), GripperConfig(), output=out, picture=picture)

    with monkeypatch.context() as patched:
        patched.setattr(gripper, "write_text", killed)
        with pytest.raises(KeyboardInterrupt):
            run()
    assert picture.is_file()
    assert not out.exists()
    run()
    assert load_gripper(str(out)).name == "toy_hand"
    out.unlink()
    picture.write_bytes(b"another picture")
    with pytest.raises(SymgraspError, match=r"mine\.png exists; give --overwrite"):
        run()
    assert not out.exists()


@pytest.mark.parametrize(
    ("pose", "note"),
    [
        ('rpy="0 0 0"', ""),
        ('xyz="0.004 0 0"', ""),  # of uneven meshes
        ('rpy="0 0 1.57079632679"', "close along x of base, not along y"),
        ('rpy="0 1.57079632679 0"', "point along x of base, not along z"),
        ('rpy="3.14159265359 0 0"', "point along -z of base, not along z"),
        ('xyz="0.03 0 0"', "middle is 30, 0, 0 mm in x, y, z beside the axis of base"),
        ('xyz="0 -0.03 0"', "middle is 0, -30, 0 mm"),
    ],
)
def test_another_axis_or_origin_of_the_base_link_is_named(pose, note, tmp_path):
    mount = (
        '<link name="base"/><joint name="mount" type="fixed"><parent link="base"/>'
        f'<child link="hand"/><origin {pose}/></joint></robot>'
    )
    text = URDF.replace("</robot>", mount)
    found, odd = measured_with_notes(tmp_path, text, base_link="base")
    assert found.max_opening == pytest.approx(0.08, abs=1e-5)
    assert len(odd) == bool(note)
    assert all(note in each and "one more fixed transform" in each for each in odd)


def test_odd_measures_are_reported(tmp_path):
    config = GripperConfig(tip_reach=0.06)
    (tmp_path / "g.urdf").write_text(URDF)
    report = gripper.run(str(tmp_path / "g.urdf"), config)
    assert "tip_reach is longer than the fingers" in report.notes["toy_hand"]
    with pytest.raises(SymgraspError, match="gripper"):
        gripper.run("no_such_preset", config)
    slip = replace(load_gripper("franka"), max_opening=0.8)  # of a decimal point
    assert gripper.oddities_of(slip) == ["max_opening is 800 mm"]


FLANGE = """<link name="flange"/><joint name="mount" type="fixed"><parent link="flange"/>
  <child link="hand"/><origin xyz="0 0 0.01" rpy="0 0 {turn}"/></joint></robot>"""


def test_fingers_may_open_at_either_limit(tmp_path):
    # As of a WSG 50: one finger opens at its lower limit, the other one at its upper limit.
    backwards = (
        '<axis xyz="0 1 0"/><limit lower="0" upper="0.04"/></joint>',
        '<axis xyz="0 -1 0"/><limit lower="-0.04" upper="0"/></joint>',
    )
    found = measured(tmp_path, URDF.replace(*backwards))
    assert {key: getattr(found, key) for key in EXPECTED} == pytest.approx(EXPECTED, abs=1e-5)


# A mobile robot with a lift and two arms (Fetch and TIAGo have a lift).
ROBOT = """<robot name="robot"><link name="chassis"/><link name="torso"/>
  <joint name="lift" type="prismatic"><parent link="chassis"/><child link="torso"/>
    <axis xyz="0 0 1"/><limit lower="0" upper="0.4"/></joint>{hands}</robot>"""


def on_torso(side):
    hand = URDF.partition("\n")[2].removesuffix("</robot>")
    for link in ("hand", "left", "right"):
        hand = hand.replace(f'link="{link}"', f'link="{link}{side}"')
        hand = hand.replace(f'link name="{link}"', f'link name="{link}{side}"')
    return f"""{hand}<joint name="arm{side}" type="fixed"><parent link="torso"/>
      <child link="hand{side}"/><origin xyz="0.3 0.2 0" rpy="0 1.2 0"/></joint>"""


@pytest.mark.parametrize(
    ("limit", "mimic"),
    [
        ("", '<mimic joint="slide_left"/>'),
        ('<limit effort="1"/>', '<mimic joint="slide_left" multiplier="1" offset="0"/>'),
        ('<limit lower="0" upper="0"/>', '<mimic joint="slide_left"/>'),
        ("", '<mimic joint="motor" multiplier="0.5" offset="-0.01"/>'),
    ],
)
def test_a_finger_that_mimics_another_joint_moves_as_far(limit, mimic, tmp_path):
    motor = """<link name="cam"/><joint name="motor" type="revolute"><parent link="hand"/>
      <child link="cam"/><limit lower="0.02" upper="0.1"/></joint></robot>"""
    follower = '<limit lower="0" upper="0.04"/><mimic joint="slide_left"/>'
    text = URDF.replace(follower, limit + mimic).replace("</robot>", motor)
    assert measured(tmp_path, text).max_opening == pytest.approx(0.08, abs=1e-5)


def test_fingers_that_mimic_each_other_without_limits_do_not_move(tmp_path):
    circle = URDF.replace('<limit lower="0" upper="0.04"/>', "")
    circle = circle.replace("</joint>", '<mimic joint="slide_right"/></joint>', 1)
    with pytest.raises(FormatError, match="measures of no gripper"):
        measured(tmp_path, circle)


def test_the_sliding_joints_of_an_arm_do_not_count(tmp_path):
    found = measured(tmp_path, ROBOT.format(hands=on_torso("_l")))
    assert {key: getattr(found, key) for key in EXPECTED} == pytest.approx(EXPECTED, abs=1e-5)


def test_one_of_several_grippers_is_named_by_its_link(tmp_path):
    robot = ROBOT.format(hands=on_torso("_l") + on_torso("_r"))
    with pytest.raises(FormatError, match="2 grippers; name one of them as base link: hand_l, han"):
        measured(tmp_path, robot)
    found = measured(tmp_path, robot, base_link="hand_r")
    assert {key: getattr(found, key) for key in EXPECTED} == pytest.approx(EXPECTED, abs=1e-5)
    with pytest.raises(FormatError, match="5 sliding joints below chassis"):
        measured(tmp_path, robot, base_link="chassis")


@pytest.mark.parametrize("turn", [0.0, np.pi / 2, -np.pi / 2, np.pi])
def test_the_mounting_face_may_be_turned_about_the_approach(turn, tmp_path):
    text = URDF.replace("</robot>", FLANGE.format(turn=turn))
    found = measured(tmp_path, text, base_link="flange")
    expected = EXPECTED | {"flange_to_tip": EXPECTED["flange_to_tip"] + 0.01}
    assert {key: getattr(found, key) for key in EXPECTED} == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize(
    "text",
    [
        URDF.replace("</robot>", FLANGE.format(turn=np.pi / 4)),
        URDF.replace("</robot>", FLANGE.format(turn=0)).replace('"0 1 0"', '"0 0 0"'),
    ],
)
def test_fingers_that_slide_along_no_axis_of_the_mounting_face_are_refused(text, tmp_path):
    with pytest.raises(FormatError, match="slide askew to flange"):
        measured(tmp_path, text, base_link="flange")


def test_a_long_chain_of_links_is_read(tmp_path):
    links = "".join(f'<link name="a{i}"/>' for i in range(900))
    joints = "".join(
        f'<joint name="j{i}" type="fixed"><parent link="{parent}"/><child link="a{i}"/></joint>'
        for i, parent in enumerate(["hand", *(f"a{i}" for i in range(899))])
    )
    found = measured(tmp_path, URDF.replace("</robot>", f"{links}{joints}</robot>"))
    assert found.max_opening == pytest.approx(0.08)


@pytest.mark.parametrize(
    ("files", "sentence"),
    [
        ({"output": "mine"}, "a file name that ends in .toml"),
        ({"output": "mine.toml", "picture": "mine"}, "cannot be stored as a file"),
        ({"picture": "mine.xyz"}, "cannot be stored as .xyz"),
    ],
)
def test_other_names_of_the_output_are_refused_before_it_is_written(files, sentence, tmp_path):
    (tmp_path / "g.urdf").write_text(URDF)
    paths = {kind: tmp_path / name for kind, name in files.items()}
    with pytest.raises(SymgraspError, match=sentence):
        gripper.run(str(tmp_path / "g.urdf"), GripperConfig(), **paths)
    assert [path.name for path in tmp_path.iterdir()] == ["g.urdf"]
