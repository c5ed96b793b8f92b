"""Agreement of docs/reference/formats.md with the files: names, ranks, types, units."""

import json
import re
import tomllib
from pathlib import Path

import h5py
import numpy as np
import pytest

from pipelines import compare
from pipelines.configs import CompareConfig, ViewConfig
from pipelines.dataset.graspnet.graspnet_labels import (
    LABEL_GRID,
    GraspLabel,
    label_offsets,
    write_grasp_label,
)
from pipelines.dataset.graspnet.graspnet_layout import FrameFiles
from pipelines.dataset.symmetry import symmetry_labels
from pipelines.dataset.symmetry.symmetry_labels import ObjectSymmetries
from pipelines.dataset.training import (
    affordance_labels,
    coco_instances,
    detector_frames,
    packed_regions,
)
from pipelines.dataset.training.affordance_labels import AffordanceLabels
from pipelines.dataset.training.packed_regions import PackedScene
from pipelines.evaluation.graspnet.dump_verdicts import FrameVerdicts, write_dump_verdicts
from pipelines.evaluation.reports.figures import split_figures
from pipelines.evaluation.reports.reports import write_report
from pipelines.evaluation.runs.tallies import RowTally
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.region_masks import RegionInstance
from pipelines.geometry.symmetry import ObjectRegion, ReflectionSymmetry, RotationSymmetry
from pipelines.grasp_files import grasps_file
from pipelines.grasp_files.gripper_files import GRIPPERS, load_gripper
from pipelines.inference.models import WEIGHTS
from pipelines.learning.critics import critic_rows
from pipelines.learning.critics.critic_rows import CriticRows
from pipelines.learning.critics.kinds import CRITIC_KINDS
from pipelines.metrics.grasp_verdicts import REASONS
from pipelines.pictures.grasp_page.scene import frame_scene
from pipelines.simulation.success import write_success
from pipelines.simulation.trial import TRIAL_OUTCOMES as TRIAL_REASONS
from pipelines.storage.provenance import make_stamp
from pipelines.storage.weights_manifest import manifest_path
from pipelines.tabletop.depth_channels import SmallFrame
from tests.pictures.grasp_page.toys import toy_frame, toy_result
from tests.stages.test_compare import write_run

DOCUMENT = Path(__file__).resolve().parents[2] / "docs/reference/formats.md"
STAMP = make_stamp("test", {})
TYPES = {
    "f2": "<f2",
    "f4": "<f4",
    "f8": "<f8",
    "i4": "<i4",
    "i8": "<i8",
    "u1": "|u1",
    "u2": "<u2",
    "u4": "<u4",
    "bool": "|b1",
}
LINE = re.compile(r"^( *)\* ((?:`\w+`(?:, )?)+)(?: \(([^)]*)\))?(?: (\w+))?(?: \[([\w. ]+)\])?")
Fact = tuple[int, str, str]  # rank, type, unit


def block(kind: str, name: str) -> str:
    """The lines of docs/reference/formats.md between `<!-- kind: name -->` and `<!-- end -->`."""
    match = re.search(rf"<!-- {kind}: {re.escape(name)} -->\n(.*?)<!-- end -->", text(), re.DOTALL)
    assert match is not None
    return match[1]


def text() -> str:
    return DOCUMENT.read_text(encoding="utf-8")


def documented(lines: str) -> dict[str, Fact]:
    """Map the path of each dataset of an indented list to its rank, type and unit."""
    facts, group = {}, ""
    for line in lines.splitlines():
        match = LINE.match(line)
        if match is None:
            continue
        indent, name, shape, dtype, unit = match.groups()
        name = name.strip("`")
        if shape == "group":
            group = f"{name}/"
            continue
        prefix = group if indent else ""
        facts[prefix + name] = (shape.count(",") + 1, dtype, unit or "")
    return facts


def stored(path: Path) -> dict[str, Fact]:
    """Map the path of each dataset of an HDF5 file to its rank, type and unit."""
    facts: dict[str, Fact] = {}

    def visit(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset):
            is_text = h5py.check_string_dtype(item.dtype) is not None
            names = [key for key, value in TYPES.items() if value == item.dtype.str]
            dtype = "text" if is_text else names[0]
            facts[name] = (item.ndim, dtype, str(item.attrs.get("units", "")))

    with h5py.File(path) as file:
        file.visititems(visit)
    return facts


def keys_of(lines: str, depth: int = 0) -> set[str]:
    """The names that lines of one indentation give in backquotes before their colon."""
    heads = [
        line.split(":")[0] for line in lines.splitlines() if line.startswith("  " * depth + "* ")
    ]
    return {name for head in heads for name in re.findall(r"`(\w+)`", head)}


def test_the_columns_of_grasps_h5_are_documented(tmp_path: Path) -> None:
    grasps_file.write(tmp_path / "x.h5", [], STAMP)
    assert stored(tmp_path / "x.h5") == documented(block("datasets", "grasps.h5"))


def test_the_attributes_of_grasps_h5_are_documented(tmp_path: Path) -> None:
    grasps_file.write(tmp_path / "x.h5", [], STAMP)
    section = text().split("\n## grasps.h5\n")[1].split("<!--")[0]
    with h5py.File(tmp_path / "x.h5") as file:
        assert set(file.attrs) == keys_of(section, depth=1)


def test_the_columns_of_affordance_files_are_documented(tmp_path: Path) -> None:
    pairs, points = np.zeros((2, 3)), np.zeros((4, 3))
    labels = AffordanceLabels(np.zeros((2, 2, 3)), pairs, np.zeros(2), points, points, np.zeros(4))
    affordance_labels.write(tmp_path / "x.h5", labels, STAMP)
    assert stored(tmp_path / "x.h5") == documented(block("datasets", "affordance"))


def test_the_columns_of_critic_rows_are_documented(tmp_path: Path) -> None:
    rows = CriticRows.none(4, CRITIC_KINDS["grasps"].features)
    critic_rows.write(tmp_path / "x.h5", rows, STAMP)
    assert stored(tmp_path / "x.h5") == documented(block("datasets", "critic rows"))


def test_the_columns_of_packed_scenes_are_documented(tmp_path: Path) -> None:
    slots, ids, names = np.zeros((1, 5, 3)), np.zeros(1), np.array(["a"], object)
    points, table = np.zeros((1, 4, 3)), np.zeros((1, 4))
    scene = PackedScene(
        points, np.zeros((1, 4)), np.zeros((1, 5)), slots, slots, table, ids, ids, names
    )
    packed_regions.write(tmp_path / "x.h5", scene, STAMP)
    assert stored(tmp_path / "x.h5") == documented(block("datasets", "packed"))


def test_the_columns_of_the_frames_of_the_detectors_training_are_documented(tmp_path: Path) -> None:
    camera = Intrinsics(1.0, 1.0, 1.0, 1.0, width=4, height=3)
    small = SmallFrame(np.zeros((3, 4, 3), np.uint8), np.zeros((3, 4), np.float32), camera)
    plane = Plane(np.array([0.0, 0.0, 1.0]), 0.5)
    frame = detector_frames.DetectorFrame(small, plane, np.zeros((3, 4), np.uint8))
    detector_frames.write(tmp_path / "x.h5", [frame], STAMP)
    assert stored(tmp_path / "x.h5") == documented(block("datasets", "detector frames"))


def test_the_arrays_of_grasp_labels_are_documented(tmp_path: Path) -> None:
    zeros = np.zeros((1, *LABEL_GRID))
    label = GraspLabel(np.zeros((1, 3)), label_offsets(zeros), zeros > 0, zeros)
    write_grasp_label(tmp_path / "x.npz", label)
    facts = documented(block("arrays", "grasp_label"))
    with np.load(tmp_path / "x.npz") as arrays:
        found = {name: (arrays[name].ndim, arrays[name].dtype.str) for name in arrays.files}
    assert found == {name: (rank, TYPES[dtype]) for name, (rank, dtype, _) in facts.items()}


def test_the_keys_of_symmetry_files_are_documented(tmp_path: Path) -> None:
    plane = ReflectionSymmetry(np.array([1.0, 0, 0]), np.zeros(3))
    axis = RotationSymmetry(np.array([1.0, 0, 0]), np.zeros(3))
    region = ObjectRegion("a", np.array([0]), (plane,))
    symmetry_labels.write(
        tmp_path / "x.json", ObjectSymmetries("o", (plane, axis), (region,)), STAMP
    )
    content = json.loads((tmp_path / "x.json").read_text())
    lines = block("keys", "symmetry")
    assert set(content) == keys_of(lines)
    below = set().union(*content["symmetries"], *content["regions"])
    assert below <= keys_of(lines, depth=1) | {"symmetries"}


def test_the_keys_of_coco_entries_are_documented(tmp_path: Path) -> None:
    files = FrameFiles(tmp_path / "images" / "scene_0000" / "kinect", 0, "kinect", 0)
    image = coco_instances.image_entry(files, 4, 3)
    region = RegionInstance(0, "whole", np.ones((3, 4), bool), 1.0, ())
    annotation = coco_instances.annotation_entry(image, 1, region, 1)
    assert set(image) == keys_of(block("keys", "coco image"), depth=1)
    documented_keys = {
        name
        for line in block("keys", "coco annotation").splitlines()
        for name in re.findall(r"`(\w+)`", line.split(": ")[0])
    }
    assert set(annotation) == documented_keys


def test_the_keys_of_reports_are_documented(tmp_path: Path) -> None:
    write_report(tmp_path / "x.json", {}, STAMP)
    assert set(json.loads((tmp_path / "x.json").read_text())) == keys_of(block("keys", "report"))


def test_the_figures_of_a_split_and_the_reasons_are_documented() -> None:
    section = text().split("\n## report.json\n")[1].split("\n## ")[0]
    figures = split_figures(RowTally(), (0.25, 0.134), 0.05)
    assert set(figures) <= set(re.findall(r"[`\"](\w+(?:\.\d)?)[`\"]", section))
    assert set(REASONS) <= set(re.findall(r"`([\w ]+)`", section))


def test_the_reasons_of_trials_are_documented() -> None:
    section = text().split("\n## success.json\n")[1].split("\n## ")[0]
    assert set(TRIAL_REASONS) <= set(re.findall(r"`([\w ]+)`", section))


def test_the_keys_of_comparisons_are_documented(tmp_path: Path) -> None:
    reports = [write_run(tmp_path / "a"), write_run(tmp_path / "b", seed=1)]
    compare.run(reports, CompareConfig(resamples=10), tmp_path / "x.json")
    assert set(json.loads((tmp_path / "x.json").read_text())) == keys_of(block("keys", "compare"))


def test_the_keys_of_reports_on_dumps_are_documented(tmp_path: Path) -> None:
    more = {"accuracy": {}, "scenes": {}, "failed": {}, "notes": {}}
    write_report(tmp_path / "x.json", {}, STAMP, protocol="graspnet", exact=False, **more)
    keys = keys_of(block("keys", "dump report"))
    assert set(json.loads((tmp_path / "x.json").read_text())) == keys


def test_the_arrays_of_dump_verdicts_are_documented(tmp_path: Path) -> None:
    frame = FrameVerdicts(0, "missing", "0000.npy is missing", 0, 0, 0, np.zeros((50, 6)))
    write_dump_verdicts(tmp_path / "x.npz", [frame], STAMP)
    facts = documented(block("arrays", "dump verdicts"))
    with np.load(tmp_path / "x.npz") as arrays:
        kinds = {n: arrays[n].dtype.str if arrays[n].dtype.kind != "U" else "text" for n in arrays}
        found = {name: (arrays[name].ndim, kind) for name, kind in kinds.items()}
    types = {**TYPES, "i1": "|i1", "text": "text"}
    assert found == {name: (rank, types[dtype]) for name, (rank, dtype, _) in facts.items()}


def test_the_keys_of_success_files_are_documented(tmp_path: Path) -> None:
    write_success(tmp_path / "x.json", [], (0.5,), STAMP)
    content = json.loads((tmp_path / "x.json").read_text())
    lines = block("keys", "success")
    assert set(content) == keys_of(lines)
    assert set(content["success"]["all"]["all"]["0.5"]) == keys_of(lines, depth=1)


def test_the_keys_of_the_weights_manifest_are_documented() -> None:
    content = json.loads(manifest_path(WEIGHTS).read_text())
    lines = block("keys", "manifest")
    assert set(content) == keys_of(lines)
    assert set(content["grasps"][0]) == keys_of(lines, depth=1)


@pytest.mark.parametrize("path", sorted(GRIPPERS.glob("*.toml")), ids=lambda path: path.stem)
def test_the_keys_of_grippers_are_documented(path: Path) -> None:
    assert set(tomllib.loads(path.read_text())) == keys_of(block("keys", "gripper"))


def test_every_link_of_the_table_leads_to_a_section() -> None:
    headings = re.findall(r"^## (.+)$", text(), re.MULTILINE)
    anchors = {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}
    assert set(re.findall(r"\]\(#([^)]+)\)", text())) <= anchors


def test_the_arrays_that_a_page_draws_are_documented() -> None:
    frame, index = toy_frame()
    scene = frame_scene(frame, toy_result(frame, index), load_gripper("rg2"), ViewConfig())
    assert set(scene) == keys_of(block("keys", "scene"))
