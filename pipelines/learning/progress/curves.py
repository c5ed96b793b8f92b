"""A picture of a training's curves, `NAME.curves.png`: a small chart per loss term or figure."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.learning.loop.runs import History
from pipelines.storage.images import write_image

WIDTH, HEIGHT = 380, 250  # pixels of a chart
LEFT, RIGHT, TOP, BOTTOM = 62, 14, 30, 30  # pixels around the plot of a chart
COLUMNS = 3
TRAIN, VAL = (44, 99, 172), (200, 80, 30)  # RGB
INK, GRID, PAPER = (60, 64, 70), (226, 229, 233), (255, 255, 255)
FONT = cv2.FONT_HERSHEY_SIMPLEX

Points = Sequence[tuple[float, float]]
Canvas = NDArray[np.uint8]


@dataclass(frozen=True)
class Chart:
    """Content of one chart: points (step, value) of the training and of validations."""

    title: str
    train: Points
    val: Points


def write_curves(path: Path, history: History, best_by: str) -> None:
    """Write the curves of `history`, the figure `best_by` first; no file if it is empty."""
    charts = charts_of(history, best_by)
    if not charts:
        return
    rows = math.ceil(len(charts) / COLUMNS)
    picture = np.full((rows * HEIGHT, COLUMNS * WIDTH, 3), PAPER, np.uint8)
    last = max(x for chart in charts for x, _ in (*chart.train, *chart.val))
    for number, chart in enumerate(charts):
        y, x = HEIGHT * (number // COLUMNS), WIDTH * (number % COLUMNS)
        picture[y : y + HEIGHT, x : x + WIDTH] = draw_chart(chart, last)
    write_image(path, picture)


def charts_of(history: History, best_by: str) -> list[Chart]:
    """Return the charts: the loss of training and validation in one chart, then one per curve.

    Curves are in order of their names, as a checkpoint keeps no other order.
    """
    val, train = sorted(history.val), sorted(history.train)
    charts = [Chart("loss", history.curve("total"), history.val.get("loss", []))]
    charts += [Chart(name, [], history.val[name]) for name in val if name != "loss"]
    charts += [Chart(name, history.curve(name), []) for name in train if name != "total"]
    charts = [Chart(each.title, _finite(each.train), _finite(each.val)) for each in charts]
    charts = [chart for chart in charts if chart.train or chart.val]
    return sorted(charts, key=lambda chart: chart.title != best_by)


def _finite(points: Points) -> Points:
    return [(x, y) for x, y in points if math.isfinite(y)]


def draw_chart(chart: Chart, last: float) -> Canvas:
    """Return the picture (HEIGHT, WIDTH, 3) of a chart whose x axis ends at step `last`."""
    canvas = np.full((HEIGHT, WIDTH, 3), PAPER, np.uint8)
    values = [y for _, y in (*chart.train, *chart.val)]
    low, high = _margins(min(values), max(values))
    _text(canvas, chart.title, LEFT, 18, 0.48)
    for tick in ticks(0.0, max(last, 1.0)):
        x = _across(tick, last)
        cv2.line(canvas, (x, TOP), (x, HEIGHT - BOTTOM), GRID)
        _text(canvas, _short(tick), x - 4 * len(_short(tick)), HEIGHT - 12, 0.36)
    for tick in ticks(low, high):
        y = _down(tick, low, high)
        cv2.line(canvas, (LEFT, y), (WIDTH - RIGHT, y), GRID)
        _text(canvas, _short(tick), LEFT - 8 - 7 * len(_short(tick)), y + 4, 0.36)
    for points, color, name in ((chart.train, TRAIN, "train"), (chart.val, VAL, "val")):
        if points:
            places = [(_across(x, last), _down(y, low, high)) for x, y in points]
            cv2.polylines(canvas, [np.array(places, np.int32)], False, color, 1, cv2.LINE_AA)
            if points is chart.val:
                for place in places:
                    cv2.circle(canvas, place, 2, color, cv2.FILLED, cv2.LINE_AA)
            left = WIDTH - RIGHT - (78 if name == "train" else 30)
            _text(canvas, name, left, 18, 0.4, color)
    return canvas


def ticks(low: float, high: float) -> list[float]:
    """Return three to six round numbers from `low` to `high`."""
    raw = (high - low) / 4.0
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * m for m in (1.0, 2.0, 2.5, 5.0, 10.0) if power * m >= raw * (1.0 - 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [number * step for number in range(first, last + 1)]


def _margins(low: float, high: float) -> tuple[float, float]:
    """Return limits slightly beyond `low` and `high`, which are never equal."""
    margin = 0.05 * (high - low) or 0.05 * max(abs(high), 1e-6)
    return low - margin, high + margin


def _across(x: float, last: float) -> int:
    return round(LEFT + x / max(last, 1.0) * (WIDTH - LEFT - RIGHT))


def _down(y: float, low: float, high: float) -> int:
    return round(TOP + (high - y) / (high - low) * (HEIGHT - TOP - BOTTOM))


def _short(value: float) -> str:
    return f"{value / 1000:g}k" if abs(value) >= 10_000 else f"{value:.4g}"


def _text(
    canvas: Canvas, text: str, x: int, y: int, size: float, color: tuple[int, int, int] = INK
) -> None:
    cv2.putText(canvas, text, (x, y), FONT, size, color, 1, cv2.LINE_AA)
