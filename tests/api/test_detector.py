"""`GraspDetector`: arrays in, the grasps of `symgrasp infer` out."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace
from inspect import signature
from threading import Barrier

import numpy as np
import pytest
import torch
from typer.main import get_command
from typer.testing import CliRunner

from pipelines.configs import FeasibilityConfig, InferConfig, LimitsConfig, SelectionConfig
from pipelines.errors import MissingInputError, SymgraspError, UnknownNameError, ValueRangeError
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.inference.models import WEIGHTS
from symgrasp import GraspDetector, Grasps, bundled_frame, read_grasps
from symgrasp_cli.app import app
from tests.geometry.tabletops import CAMERA, Box, Can, render

LIGHT = InferConfig(regions="geometric", method="planar")
DEPTH, INDEX = render([Can(0.035, 0.12), Box((0.05, 0.05, 0.05), (0.15, 0, 0))])
COLOR = np.full((*DEPTH.shape, 3), 90, np.uint8)


@pytest.fixture(scope="module")
def detector():
    return GraspDetector(device="cpu")


@pytest.fixture(scope="module")
def light():
    return GraspDetector(settings=LIGHT)


def assert_same(one: Grasps, other: Grasps):
    for field in fields(Grasps):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if isinstance(a, np.ndarray):
            assert a.dtype == b.dtype
            np.testing.assert_array_equal(a, b)
        elif field.name not in ("name", "regions"):
            assert a == b
    for a, b in zip(one.regions, other.regions, strict=True):
        np.testing.assert_array_equal(a.mask, b.mask)
        assert (a.source, a.confidence) == (b.source, b.confidence)
        for s, t in zip(a.symmetries, b.symmetries, strict=True):
            assert (s.slot, s.existence, s.confidence) == (t.slot, t.existence, t.confidence)
            np.testing.assert_array_equal(s.point, t.point)
            np.testing.assert_array_equal(s.direction, t.direction)


def test_the_grasps_of_a_bundled_frame_are_those_of_the_command_bit_for_bit(detector, tmp_path):
    out = tmp_path / "grasps.h5"
    command = [
        "infer",
        str(WEIGHTS / "frames" / "table_1_depth.png"),
        "--out",
        str(out),
        "--device",
        "cpu",
    ]
    assert CliRunner().invoke(app, command).exit_code == 0
    ((name, written),) = read_grasps(out).items()
    assert name == "table_1"
    found = detector(*bundled_frame("table_1"))
    assert len(found) > 10
    assert_same(found, written)


@pytest.mark.parametrize("command", ["infer", "serve"])
@pytest.mark.parametrize("name", ["seed", "device"])
def test_the_default_of_an_argument_is_that_of_the_option(name, command):
    (option,) = [p for p in get_command(app).commands[command].params if p.name == name]
    assert signature(GraspDetector).parameters[name].default == option.default


def test_two_threads_find_the_grasps_that_one_finds(detector):
    frames = [bundled_frame("table_1"), bundled_frame("table_2")]
    expected = [detector(*frame) for frame in frames]
    together = Barrier(2)

    def work(frame):
        together.wait()
        return detector(*frame)

    with ThreadPoolExecutor(2) as pool:
        for found, alone in zip(pool.map(work, frames), expected, strict=True):
            assert_same(found, alone)


def test_the_same_frame_gives_the_same_grasps_each_time(light):
    lens = CAMERA.lens
    assert_same(light(COLOR, DEPTH, lens), light(COLOR, DEPTH, lens))


def test_the_users_masks_become_the_regions_and_number_their_instances(light):
    ids = np.select([INDEX == 0, INDEX == 1], [9, 4])
    by_id = light(COLOR, DEPTH, CAMERA, masks=ids)
    assert [(r.source, r.instance) for r in by_id.regions] == [("masks", 4), ("masks", 9)]
    np.testing.assert_array_equal(by_id.regions[1].mask, INDEX == 0)
    stacked = light(COLOR, DEPTH, CAMERA, masks=[INDEX == 1, INDEX == 0])
    assert [r.instance for r in stacked.regions] == [0, 1]
    assert_same(stacked, by_id)
    assert light.frame_result(COLOR, DEPTH, CAMERA, masks=ids).regions.instance.tolist() == [4, 9]


def test_a_detector_that_another_process_receives_finds_the_same_grasps(light):
    received = pickle.loads(pickle.dumps(light))
    assert_same(received(COLOR, DEPTH, CAMERA), light(COLOR, DEPTH, CAMERA))


def test_grasps_keep_to_the_workspace(light):
    everywhere = light(COLOR, DEPTH, CAMERA)
    assert set(everywhere.region) == {0, 1}
    box = (0.08, -1.0, 0.0, 1.0, 1.0, 2.0)
    right = light(COLOR, DEPTH, CAMERA, workspace=box)
    assert len(right)
    assert (right.translation[:, 0] > 0.08).all()
    by_setting = GraspDetector(settings=replace(LIGHT, limits=LimitsConfig(box=box)))
    assert_same(by_setting(COLOR, DEPTH, CAMERA), right)
    none = light(COLOR, DEPTH, CAMERA, workspace=np.zeros(DEPTH.shape, bool))
    assert (none.status, len(none)) == ("empty", 0)
    assert "workspace" in none.message


def test_a_gripper_is_given_by_name_by_file_or_as_an_object(tmp_path):
    narrow = replace(load_gripper("rg2"), name="narrow", max_opening=0.06)
    lines = [f"{f.name} = {getattr(narrow, f.name)!r}" for f in fields(narrow)]
    path = tmp_path / "narrow.toml"
    path.write_text("\n".join(lines).replace("'", '"'))
    by_file = GraspDetector(path, settings=LIGHT)
    made = GraspDetector(narrow, settings=LIGHT)
    assert by_file.gripper == made.gripper == narrow
    assert_same(by_file(COLOR, DEPTH, CAMERA), made(COLOR, DEPTH, CAMERA))
    assert made(COLOR, DEPTH, CAMERA).opening.max() <= 0.06 + 1e-6
    assert GraspDetector("franka", settings=LIGHT).gripper.name == "franka"


def test_settings_are_changed_by_name_by_a_file_or_all_at_once(tmp_path):
    names = {"regions": "geometric", "method": "planar", "selection.feasibility.min_width": 0.06}
    by_name = GraspDetector(settings=names)
    path = tmp_path / "infer.toml"
    tables = "[selection.feasibility]\nmin_width = 0.06\n[watch]\npoll = 1\n"
    path.write_text('regions = "geometric"\nmethod = "planar"\n' + tables)
    checks = FeasibilityConfig(min_width=0.06)
    config = replace(LIGHT, selection=SelectionConfig(feasibility=checks))
    by_file, whole = GraspDetector(settings=str(path)), GraspDetector(settings=config)
    assert by_name.settings == by_file.settings == whole.settings == config
    found = by_name(COLOR, DEPTH, CAMERA)
    assert len(found)
    assert found.width.min() >= 0.06
    assert GraspDetector(settings=LIGHT)(COLOR, DEPTH, CAMERA).width.min() < 0.06


def test_a_device_is_given_by_name_or_as_torch_names_it():
    detector = GraspDetector("rg2", device=torch.device("cpu"))
    assert detector(*bundled_frame())


def test_the_gripper_argument_goes_before_the_gripper_setting():
    settings = {"regions": "geometric", "method": "planar", "gripper": "franka"}
    assert GraspDetector(settings=settings).gripper.name == "franka"
    assert GraspDetector("rg2", settings=settings).gripper.name == "rg2"


def test_nothing_is_written_and_no_picture_kept(light, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    color, depth = COLOR.copy(), DEPTH.copy()
    found = light(color, depth, CAMERA)
    width = found.width.copy()
    color[:], depth[:] = 0, 0
    np.testing.assert_array_equal(found.width, width)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "kind", "sentence"),
    [
        ({"gripper": "panda"}, UnknownNameError, "'panda' is not known.*; .*franka"),
        (
            {"settings": {"selection.feasibility.min_with": 0.1}},
            UnknownNameError,
            "'selection.feasibility.min_width'",
        ),
        (
            {"settings": {"selection.feasibility.min_width": "wide"}},
            SymgraspError,
            "min_width is 'wide'; .* m",
        ),
        ({"settings": {"method": "plane"}}, UnknownNameError, "nearest is 'planar'"),
        ({"settings": InferConfig(method="plane")}, UnknownNameError, "nearest is 'planar'"),
        ({"settings": "none.toml"}, MissingInputError, "none.toml does not exist"),
        ({"settings": 3}, SymgraspError, "settings is 3; it must be a mapping"),
        ({"device": "gpu"}, UnknownNameError, "device 'gpu' is not known"),
        ({"gripper": ""}, UnknownNameError, "gripper '' is not known"),
        ({"preset": 3}, UnknownNameError, "preset '3' is not known"),
        ({"device": 0}, UnknownNameError, "device '0' is not known"),
        ({"device": None}, UnknownNameError, "device 'None' is not known"),
        ({"network": 3}, ValueRangeError, "^network is 3; it must be a file of weights"),
        ({"device": "cuda:99"}, SymgraspError, "^device is cuda:99; it must be cpu"),
        ({"gripper": {"name": "mine"}}, SymgraspError, "^gripper is a dict; it must be a preset"),
        (
            {"settings": {"limits.approach_direction": (0, 0, 0)}},
            SymgraspError,
            "^approach_direction is .*; it must be x,y,z, not all zero",
        ),
        ({"seed": -1}, ValueRangeError, "^seed is -1; it must be a whole number, at least 0$"),
        ({"seed": 1.5}, ValueRangeError, "^seed is 1.5; it must be a whole number"),
        ({"seed": "a"}, ValueRangeError, "^seed is 'a'; it must be a whole number"),
        ({"network": "none.safetensors"}, MissingInputError, "none.safetensors does not exist"),
        ({"detector": "none.safetensors"}, MissingInputError, "none.safetensors does not exist"),
        ({"axis_critic": "none.safetensors"}, MissingInputError, "none.safetensors does not"),
        ({"plane_critic": "none.safetensors"}, MissingInputError, "none.safetensors does not"),
        ({"grasp_critic": "none.safetensors"}, MissingInputError, "none.safetensors does not"),
    ],
)
def test_files_and_names_that_cannot_be_loaded_are_reported_when_the_detector_is_made(
    options, kind, sentence
):
    with pytest.raises(kind, match=sentence):
        GraspDetector(**options)


def test_arrays_that_make_no_frame_are_refused_in_one_sentence(light):
    with pytest.raises(SymgraspError, match="color is an array"):
        light(COLOR / 255, DEPTH, CAMERA)
    with pytest.raises(SymgraspError, match="masks is an array"):
        light(COLOR, DEPTH, CAMERA, masks=np.ones((2, 2), bool))
    with pytest.raises(SymgraspError, match="workspace is"):
        light(COLOR, DEPTH, CAMERA, workspace=(1, 2, 3))
    with pytest.raises(SymgraspError, match=r"^workspace is .* divide millimetres by 1000"):
        light(COLOR, DEPTH, CAMERA, workspace=(-200, -200, 400, 200, 200, 1200))
    of_halved = {"width": 2 * CAMERA.width, "height": 2 * CAMERA.height}
    with pytest.raises(SymgraspError, match=r"describes .*, intrinsics [0-9.,]+ if it is"):
        light(COLOR, DEPTH, {"fx": 600, "fy": 600, "cx": 320, "cy": 240, **of_halved})
