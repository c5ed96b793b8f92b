"""Intervals of a report's figures, by a bootstrap over scenes or frames."""

from dataclasses import replace

import numpy as np
import pytest

from pipelines.configs import IntervalConfig
from pipelines.evaluation.reports.intervals import RowIntervals
from pipelines.evaluation.runs.records import FrameRecord, RowRecord, ScoredPredictions
from pipelines.evaluation.runs.run_readers import threshold_keys
from pipelines.metrics.grasp_verdicts import Verdict


def frame(number, split, qualities, correct=(1, 0), name=""):
    """A frame of objects with `qualities`, and predictions of planes that are right or wrong.

    Unless named, it is in no scene of GraspNet's layout.
    """
    verdicts = [Verdict(k, "held", quality, 1 - quality) for k, quality in enumerate(qualities)]
    confidence = list(np.linspace(0.9, 0.1, len(correct)))
    scored = ScoredPredictions(2, confidence, {"0.25": list(correct)})
    masks = ScoredPredictions(2, [0.9], {"0.5": [1]})
    rows = {"ours": RowRecord(verdicts, {"reflection": scored})}
    return FrameRecord(name or f"{split}/{number:04d}", split, np.nan, masks, rows)


def views(scenes, per_scene, rng):
    """Frames of `scenes` scenes, whose views show the same objects: their qualities are equal."""
    objects = {scene: rng.random(4) for scene in range(scenes)}
    return [
        frame(
            view, "seen", objects[scene], name=f"scenes/scene_{100 + scene:04d}/kinect/{view:04d}"
        )
        for scene in range(scenes)
        for view in range(per_scene)
    ]


def width(found):
    low, high = found["all"]["grasp_quality"]
    return high - low


def intervals_of(frames, unit=IntervalConfig.unit):
    found = RowIntervals(threshold_keys(0.25, 0.05), unit)
    for each in frames:
        found.add(each)
    rows = {"ours": {split: {} for split in ("seen", "all")}}
    found.add_to(rows)
    return {split: figures["intervals"] for split, figures in rows["ours"].items()}


def test_the_interval_of_a_mean_contains_it_as_often_as_stated():
    rng = np.random.default_rng(0)
    held = 0
    for _ in range(60):
        found = intervals_of(frame(k, "seen", rng.random(4)) for k in range(30))
        low, high = found["all"]["grasp_quality"]
        assert 0.05 < high - low < 0.25
        held += low <= 0.5 <= high
    assert held >= 52


def test_equal_frames_show_no_spread_and_have_no_interval():
    # Eight of eight right leave rates from 0.025 ** (1 / 8) = 0.63 on possible, not only 1.
    found = intervals_of(frame(k, "seen", [0.5, 0.7]) for k in range(8))
    assert found["seen"] == {}


def test_only_the_figure_that_is_the_same_in_all_frames_lacks_an_interval():
    found = intervals_of(frame(k, "seen", [0.1 * k, 0.7], correct=(1, 1)) for k in range(8))
    assert "grasp_quality" in found["seen"]
    assert "symmetry_ap reflection" not in found["seen"]


def test_few_frames_have_no_interval():
    frames = [frame(k, "seen", [0.1 * k, 0.7]) for k in range(6)]
    assert intervals_of(frames[:5])["all"] == {}
    assert "grasp_quality" in intervals_of(frames)["all"]


def test_ap_by_graspnets_protocol_is_a_mean_over_frames_for_any_number_of_objects():
    frames = [frame(k, "seen", [0.5] * (1 + 3 * (k % 2))) for k in range(8)]
    for k, each in enumerate(frames):
        each.rows["ours"].accuracy.extend([0.2 * (k % 2)] * 6)
    low, high = intervals_of(frames)["all"]["ap"]
    assert low < 0.1 < high
    assert (low + high) / 2 == pytest.approx(0.1, abs=0.02)


def test_a_figure_that_older_records_lack_has_no_interval():
    frames = [frame(k, "seen", [0.5, 0.1 * k]) for k in range(8)]
    for each in frames[1:]:
        each.rows["ours"].accuracy.extend([0.5] * 6)
    found = intervals_of(frames)["all"]
    assert "ap" not in found
    assert "grasp_quality" in found


def test_views_of_a_scene_add_nothing_to_what_its_objects_show():
    frames = views(8, 4, np.random.default_rng(0))
    by_scene, one_view_each = intervals_of(frames)["all"], intervals_of(frames[::4])["all"]
    assert by_scene["grasp_quality"] == pytest.approx(one_view_each["grasp_quality"])
    assert width(intervals_of(frames, "frame")) < 0.7 * width(intervals_of(frames))


def test_the_interval_over_scenes_contains_the_mean_as_often_as_stated():
    rng, held = np.random.default_rng(1), {"scene": 0, "frame": 0}
    for _ in range(60):
        frames = views(10, 6, rng)
        for unit in held:
            low, high = intervals_of(frames, unit)["all"]["grasp_quality"]
            held[unit] += low <= 0.5 <= high
    assert held["scene"] >= 52
    assert held["frame"] < 45


def test_masks_of_another_row_have_an_interval_if_all_its_regions_are_known():
    def frames(known):
        for k in range(8):
            one = frame(k, "seen", [0.5])
            right, wrong = (ScoredPredictions(2, [0.9], {"0.5": [r]}) for r in (1, 0))
            own = (right if k % 2 else wrong) if k < known else None
            yield replace(one, rows={**one.rows, "second": RowRecord([], masks=own)})

    def found(known):
        intervals = RowIntervals(threshold_keys(0.25, 0.05), "scene")
        for each in frames(known):
            intervals.add(each)
        rows = {"second": {"all": {}}}
        intervals.add_to(rows)
        return rows["second"]["all"]["intervals"]

    low, high = found(8)["mask_ap50"]
    assert low < 0.25 < high  # ours are all found and have no interval
    assert "mask_ap50" not in found(7)
    assert "mask_ap50" not in found(0)


def test_few_scenes_have_no_interval_for_any_number_of_views():
    frames = views(5, 8, np.random.default_rng(2))
    assert intervals_of(frames)["all"] == {}
    assert "grasp_quality" in intervals_of(frames, "frame")["all"]


def test_two_cameras_of_a_scene_see_one_unit():
    frames = views(6, 2, np.random.default_rng(3))
    moved = [
        replace(each, name=each.name.replace("kinect/0001", "realsense/0000")) for each in frames
    ]
    assert intervals_of(moved) == intervals_of(frames)
