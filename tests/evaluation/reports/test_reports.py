"""report.json and objects.json."""

import json
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from pipelines.dataset import object_list
from pipelines.dataset.object_list import ObjectRecord
from pipelines.errors import FormatError, SymgraspError
from pipelines.evaluation.reports.reports import (
    incomplete_notes,
    read_report,
    read_success,
    read_successes,
    read_table,
    refuse_other_page,
    write_report,
)
from pipelines.geometry.symmetry import RotationSymmetry
from pipelines.simulation.success import write_success
from pipelines.storage.files import write_json
from pipelines.storage.provenance import is_finished, make_stamp, stamp_ahead

STAMP = make_stamp("evaluate", {"gripper": "rg2"})


def test_a_report_is_plain_json_with_null_for_what_is_unknown(tmp_path: Path) -> None:
    path = tmp_path / "report.json"
    figures = {"grasp_quality": np.float64(0.5), "mask_ap50": float("nan"), "frames": np.int64(3)}
    write_report(
        path, {"ours": {"seen": figures}}, STAMP, seconds_per_frame=0.25, curve=np.arange(3)
    )
    content = json.loads(path.read_text())
    assert content["rows"]["ours"]["seen"] == {
        "grasp_quality": 0.5, "mask_ap50": None, "frames": 3
    }  # fmt: skip
    assert content["seconds_per_frame"] == 0.25
    assert content["curve"] == [0, 1, 2]
    assert is_finished(path, STAMP)
    assert read_report(path) == content


def test_a_file_without_rows_is_refused_as_report(tmp_path: Path) -> None:
    (tmp_path / "report.json").write_text("[]")
    with pytest.raises(FormatError, match="rows"):
        read_report(tmp_path / "report.json")


@pytest.mark.parametrize(
    ("page", "is_ours"),
    [
        ("<title>SymGrasp: 3 frames, 5 objects</title>", True),
        ("<title>dump: GraspNet&#39;s AP, exact</title>", True),
        ("<title>My notes</title>", False),
        ("", False),
    ],
)
def test_another_page_next_to_a_report_is_not_replaced(tmp_path, page: str, is_ours: bool) -> None:
    report, found = tmp_path / "report.json", tmp_path / "report.html"
    refuse_other_page(report)
    found.write_text(page)
    with nullcontext() if is_ours else pytest.raises(SymgraspError, match="no page of a report"):
        refuse_other_page(report)
    stamp_ahead(found, STAMP)  # as `compare` does
    found.write_text(page)
    with pytest.raises(SymgraspError, match="no page of a report"):
        refuse_other_page(report)


INPUTS = {"grasps": "sha256:1", "with planes": "sha256:2"}
SETTINGS = {"min_visible_pixels": 300, "min_region_share": 0.3, "baselines": True}


def simulated(path: Path, grasps: str = "sha256:1", seed: int = 0, **changed: object) -> Path:
    stamp = make_stamp("simulate", SETTINGS | changed, seed=seed, inputs={"grasps": grasps})
    content = {"success": {}, "frictions": [], "format_version": 1}
    write_json(path, content | {"provenance": stamp.as_json()})
    return path


def test_rates_without_the_scenes_that_failed_are_noted(tmp_path: Path) -> None:
    for failed in ({}, {"scene_0100_realsense": "its label is damaged"}):
        write_success(tmp_path / "s.json", [], (0.5,), make_stamp("simulate", {}), failed)
        notes = incomplete_notes({"ours": read_success(tmp_path / "s.json")})
        assert ("failed" in read_success(tmp_path / "s.json")) == bool(failed)
        assert list(notes) == ["success of ours"] * len(failed)
    assert "scene_0100_realsense: its label is damaged" in notes["success of ours"]


@pytest.mark.parametrize(
    ("changed", "fault"),
    [
        ({"min_visible_pixels": 100}, "min_visible_pixels 100 instead of 300"),
        ({"min_region_share": 0.5}, "min_region_share 0.5 instead of 0.3"),
        ({"seed": 3}, "seed 3 instead of 0"),
    ],
)
def test_success_of_other_objects_or_other_random_grasps_is_refused(tmp_path, changed, fault):
    path = simulated(tmp_path / "success.json", **changed)
    stamp = make_stamp("evaluate", SETTINGS, inputs=INPUTS)
    with pytest.raises(FormatError, match=rf"other settings \({fault}\); run simulate and"):
        read_successes([path], stamp)


def test_the_seed_of_a_simulation_matters_only_for_random_grasps_that_are_read(tmp_path):
    stamp = make_stamp("evaluate", SETTINGS, inputs=INPUTS)
    alone = simulated(tmp_path / "alone.json", seed=3, baselines=False)
    theirs = simulated(tmp_path / "planes.json", "sha256:2", seed=3)
    assert list(read_successes([alone, theirs], stamp)) == ["ours", "planes"]


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        ([], "a title, a header"),
        ({"title": "t", "header": ["a"]}, "a title, a header"),
        ({"title": "t", "header": ["a"], "rows": [[1.5]]}, "wrong type"),
        ({"title": "t", "header": ["a"], "rows": [], "more": 1}, "`more` is not known"),
        (
            {"title": "t", "header": ["a", "b"], "rows": [["1"]]},
            "has 1 cells in a row, 2 in the header",
        ),
    ],
)
def test_a_wrong_further_table_is_reported_in_one_sentence(tmp_path, content, fault):
    path = tmp_path / "table.json"
    path.write_text(json.dumps(content))
    with pytest.raises(FormatError, match=fault):
        read_table(path)


def test_the_list_of_objects_comes_back_in_order(tmp_path: Path) -> None:
    axis = RotationSymmetry(np.array([0.0, 0, 1]), np.zeros(3))
    can = ObjectRecord(4, "can_01", "can", "seen", (axis,), {"radius": 0.03})
    made = [can, ObjectRecord(1, "mug", "mug")]
    object_list.write(tmp_path / "objects.json", made, STAMP)
    first, second = object_list.read(tmp_path / "objects.json")
    assert (first.object_id, first.family, first.symmetries) == (1, "mug", ())
    assert second.symmetries[0].kind == "rotation"
    assert second.details == {"radius": 0.03}


@pytest.mark.parametrize("content", [{}, {"objects": [{"name": "x"}]}, {"objects": [3]}])
def test_a_wrong_list_of_objects_is_reported_in_one_sentence(
    tmp_path: Path, content: object
) -> None:
    (tmp_path / "objects.json").write_text(json.dumps(content))
    with pytest.raises(FormatError, match=r"objects\.json"):
        object_list.read(tmp_path / "objects.json")
