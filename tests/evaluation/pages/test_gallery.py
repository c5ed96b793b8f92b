"""The choice of frames that a page shows, and the places of their numbers."""

import cv2
import numpy as np

from pipelines.evaluation.pages.gallery import (
    WIDTH,
    FrameChoice,
    _middle,
    _picture,
    _spread,
    _window,
)
from pipelines.evaluation.runs.records import FrameRecord, RowRecord, ScoredPredictions
from pipelines.metrics.grasp_verdicts import Verdict
from pipelines.pictures.overlays import draw_overlay
from tests.pictures.grasp_page.toys import toy_frame, toy_result

FRAME, INDEX = toy_frame()
RESULT = toy_result(FRAME, INDEX)


class ToyRoot:
    """A dataset of the toy frame."""

    def frame(self, name: str) -> str:
        return name

    def read_label(self, files: str) -> np.ndarray:
        return INDEX + 1

    def read_frame(self, files: str):
        return FRAME


def record(name: str, *qualities: float) -> FrameRecord:
    verdicts = [Verdict(i, "held", quality, 1 - quality) for i, quality in enumerate(qualities)]
    return FrameRecord(name, "seen", 0.1, ScoredPredictions(0), {"ours": RowRecord(verdicts)})


def choice(*scenes: list[FrameRecord]) -> FrameChoice:
    gathered = FrameChoice()
    for records in scenes:
        gathered.add(records)
    return gathered


def test_a_scene_gives_its_best_and_its_worst_frame():
    scene = [record("a", 0.5), record("b", 0.9, 0.7), record("c", 0.1, 0.2)]
    best, worst = choice(scene).chosen()
    assert [r.name for r in best] == ["b"]
    assert [r.name for r in worst] == ["c"]


def test_the_best_are_in_falling_the_worst_in_rising_order_and_no_frame_is_shown_twice():
    scenes = [[record(f"{i}", i / 10)] for i in range(9)]
    best, worst = choice(*scenes).chosen(count=4)
    assert [r.name for r in worst] == ["0", "1", "2", "3"]
    assert [r.name for r in best] == ["8", "7", "6", "5"]
    best, worst = choice(*scenes).chosen(count=6)
    assert len(worst) == 6
    assert [r.name for r in best] == ["8", "7", "6"]


def test_each_row_is_judged_by_its_own_grasps():
    frames = [record("a", 0.1), record("b", 0.9)]
    for frame, quality in zip(frames, (0.8, 0.2), strict=True):
        frame.rows["gg-cnn"] = RowRecord([Verdict(0, "held", quality, 1 - quality)])
    other = FrameChoice("gg-cnn")
    other.add(frames)
    assert [each.name for each in other.chosen()[1]] == ["b"]
    assert [each.name for each in choice(frames).chosen()[1]] == ["a"]


def test_frames_without_visible_objects_are_not_shown():
    assert choice([record("a")]).chosen() == ([], [])


def test_the_window_holds_the_objects_and_has_the_aspect_of_the_image():
    objects = np.zeros((480, 640), bool)
    objects[200:260, 500:600] = True
    left, top, right, bottom = _window(objects)
    assert left <= 500
    assert right >= 600
    assert top <= 200
    assert bottom >= 260
    assert (right - left) / (bottom - top) == 640 / 480
    assert right - left < 640
    assert _window(np.ones((480, 640), bool)) == (0, 0, 640, 480)
    assert _window(np.zeros((480, 640), bool)) == (0, 0, 640, 480)


def test_a_number_stands_on_its_object():
    mask = np.zeros((100, 200), bool)
    mask[10:20, 100:120] = True
    x, y = _middle(mask, (50, 0, 150, 50))
    assert 0.5 <= x <= 0.7
    assert 0.2 <= y <= 0.4


def test_numbers_do_not_hide_each_other():
    places = [(0.5, 0.5), (0.505, 0.5), (0.5, 0.51), (0.9, 0.9)]
    moved = np.array(_spread(places, (640, 480))) * (640, 480)
    distances = np.linalg.norm(moved[:, None] - moved[None], axis=2) + 1e9 * np.eye(4)
    assert distances.min() > 30
    assert np.allclose(moved[3], (0.9 * 640, 0.9 * 480))
    assert _spread([], (640, 480)) == []


def test_lines_and_labels_are_drawn_onto_the_enlarged_picture():
    picture = _picture(record("a", 0.5, 0.5), "ours", RESULT, ToyRoot(), {0: "can"})
    shown = cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    assert shown.shape[:2] == picture.size[::-1]
    wanted = draw_overlay(FRAME, RESULT, _window(INDEX >= 0), WIDTH)
    assert np.abs(shown.astype(int) - wanted).mean() < 4
    assert [tag.name for tag in picture.tags] == ["can", "object 001"]
