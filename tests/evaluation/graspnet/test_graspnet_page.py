"""The page of a dump's report, and the figures that the page shows."""

import numpy as np
import pytest

from pipelines.evaluation.graspnet.graspnet_figures import DumpTally
from pipelines.evaluation.graspnet.graspnet_page import dump_page
from pipelines.metrics.graspnet.graspnet_ap import RANKS, accuracy
from pipelines.metrics.graspnet.graspnet_frames import DUMP_REASONS
from tests.evaluation.page_reader import Reader

HELD = DUMP_REASONS.index("held")


def verdicts(frictions: list[list[float]]) -> dict:
    """Return the verdicts on a scene's frames; every grasp that does not hold collides."""
    most = max(map(len, frictions))
    reason = np.full((len(frictions), most), -1)
    for row, found in zip(reason, frictions, strict=True):
        row[: len(found)] = [HELD if friction > 0 else 0 for friction in found]
    none = np.zeros(len(frictions), int)
    return {
        "frame_id": np.arange(len(frictions)),
        "status": np.array([0 if found else 1 for found in frictions]),
        "rows": np.array([len(found) for found in frictions]),
        "left_out": none,
        "straightened": none,
        "accuracy": np.stack([accuracy(found) for found in frictions]),
        "reason": reason,
    }


def tally() -> DumpTally:
    made = DumpTally()
    made.add("scene_0100_kinect", "kinect", 100, verdicts([[0.2] * 60, []]))
    made.add("scene_0160_kinect", "kinect", 160, verdicts([[-1.0, 0.4], [0.8] * 5]))
    return made


def report(made: DumpTally) -> dict:
    return {
        "rows": made.rows(),
        "accuracy": made.accuracy(),
        "scenes": made.scenes,
        "exact": False,
        "provenance": {"seed": 0, "config": {}, "inputs": {"dump": "sha256:0"}, "version": "1"},
    }


def test_the_mean_of_a_curve_is_the_average_precision():
    made = tally()
    for split, curves in made.accuracy()["kinect"].items():
        found = made.rows()["kinect"][split]
        assert np.mean(curves["mean"]) == pytest.approx(found["ap"])
        assert np.mean(curves["held"]["0.4"]) == pytest.approx(found["ap_0.4"])
        assert len(curves["reachable"]) == RANKS


def test_no_curve_is_above_the_limit_that_its_number_of_grasps_sets():
    curves = tally().accuracy()["kinect"]
    assert curves["seen"]["reachable"] == [0.5] * RANKS  # one frame of two has 60 grasps
    assert curves["novel"]["reachable"][3] == pytest.approx((2 / 4 + 1) / 2)
    for each in curves.values():
        assert (np.array(each["held"]["1.2"]) <= np.array(each["reachable"]) + 1e-12).all()


def test_a_scene_has_its_own_figures_and_splits_without_frames_no_curve():
    made = tally()
    assert made.scenes["scene_0160_kinect"]["split"] == "novel"
    assert made.scenes["scene_0100_kinect"]["ap"] == pytest.approx(0.5)
    assert made.scenes["scene_0100_kinect"]["frames_absent"] == 1
    assert set(made.accuracy()["kinect"]) == {"seen", "novel", "all"}


def test_the_page_shows_every_scene_curve_and_fault_and_needs_no_other_file():
    faults = {"scene_0100_kinect": "<script>0001.npy</script> is missing"}
    read = Reader(dump_page(report(tally()), "my <dump>", faults))
    assert "my <dump>" in read.text
    assert "<script>0001.npy</script> is missing" in read.text
    assert not {"dump", "script"} & {tag for tag, _ in read.found}
    for scene in tally().scenes:
        assert scene in read.text
    lines = [attributes["points"] for tag, attributes in read.found if tag == "polyline"]
    assert len(lines) == 1 + 6 + 2  # reachable, frictions, splits
    assert all(len(points.split()) == RANKS for points in lines)
    assert not any("src" in attributes or "href" in attributes for _, attributes in read.found)


def test_the_page_of_a_dump_without_judged_frames_gives_the_reason():
    page = dump_page(report(DumpTally()), "dump", {"scene_0100_kinect": "has no poses"})
    assert "has no poses" in Reader(page).text
