"""The history of a training and the picture of it."""

import json
import math
from dataclasses import asdict
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipelines.learning.loop.runs import MOST_POINTS, History, Progress
from pipelines.learning.progress import curves
from pipelines.learning.progress.curves import charts_of, draw_chart, ticks, write_curves


def history_of(values):
    history = History()
    for value in values:
        history.add_losses({"total": value, "part": 2.0 * value})
    return history


@given(st.integers(0, 3 * MOST_POINTS))
def test_a_long_history_is_thinned_and_keeps_its_mean(count):
    history = history_of(float(i) for i in range(count))
    assert len(history.curve("total")) < MOST_POINTS
    shown = len(history.train.get("total", [])) * history.every
    assert shown + history.num_pending == count
    total = sum(history.train.get("total", [])) * history.every + history.pending.get("total", 0.0)
    assert total == pytest.approx(count * (count - 1) / 2)
    for x, y in history.curve("total"):
        assert y == pytest.approx(x - 0.5)  # a point is in the middle of its steps


def test_a_history_survives_the_checkpoint():
    progress = Progress(epoch=1, history=history_of([3.0, 2.0]))
    progress.history.add_figures(2, {"loss": 1.5})
    again = Progress.of(json.loads(json.dumps(asdict(progress))), Path("c.safetensors"))
    assert again.history.curve("total") == progress.history.curve("total")
    again.history.add_figures(4, {"loss": 1.0})
    assert [value for _, value in again.history.val["loss"]] == [1.5, 1.0]


def test_the_picture_of_a_resumed_training_is_that_of_an_uninterrupted_one():
    history = History()
    history.add_losses({"total": 3.0, "part": 2.0, "another": 1.0})
    history.add_figures(1, {"loss": 1.5, "b": 20.0, "a": 2.0})
    content = json.loads(json.dumps(asdict(Progress(history=history)), sort_keys=True))
    resumed = Progress.of(content, Path("c.safetensors")).history
    assert charts_of(resumed, "b") == charts_of(history, "b")


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6))
def test_ticks_are_few_round_numbers_within_the_range(low, span):
    found = ticks(low, low + span)
    assert 2 <= len(found) <= 7
    slack = 1e-6 * (abs(low) + span)
    assert low - slack <= found[0]
    assert found[-1] <= low + span + slack


def test_the_deciding_figure_comes_first_and_train_and_val_share_a_chart():
    history = history_of([3.0, 2.0])
    history.add_figures(2, {"loss": 1.5, "angle": 20.0, "absent": math.nan})
    titles = [chart.title for chart in charts_of(history, "angle")]
    assert titles == ["angle", "loss", "part"]
    loss = charts_of(history, "loss")[0]
    assert len(loss.train) == 2
    assert loss.val == [(2, 1.5)]


def test_a_falling_loss_is_drawn_falling():
    (chart, _) = charts_of(history_of([4.0, 3.0, 2.0, 1.0]), "loss")
    picture = draw_chart(chart, 4.0).astype(int)
    rows, columns = np.nonzero(np.abs(picture - curves.TRAIN).sum(-1) < 30)
    inside = rows > curves.TOP  # not the legend
    rows, columns = rows[inside], columns[inside]
    assert rows[columns.argmin()] < rows[columns.argmax()]


def test_the_picture_is_written_whole_and_only_if_there_is_a_history(tmp_path):
    path = tmp_path / "x.curves.png"
    write_curves(path, History(), "loss")
    assert not path.exists()
    write_curves(path, history_of([2.0, 1.0]), "loss")
    assert cv2.imread(str(path)).shape == (curves.HEIGHT, curves.COLUMNS * curves.WIDTH, 3)
    assert [each.name for each in tmp_path.iterdir()] == ["x.curves.png"]
