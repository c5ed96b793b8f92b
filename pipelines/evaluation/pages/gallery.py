"""The best and the worst frames of a report as pictures, with the outcome of each object.

The views of a scene are much alike, so a scene gives at most its best and its worst frame. Frames
are ordered by the mean quality of a row's grasps on the visible objects.
"""

from base64 import b64encode
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pipelines.array_types import Mask
from pipelines.dataset import object_list
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.errors import SymgraspError
from pipelines.evaluation.rows import OURS, ordered_rows, report_row
from pipelines.evaluation.runs.records import FrameRecord
from pipelines.grasp_files.grasps_stream import read_index, read_results
from pipelines.grasp_files.grasps_tables import FrameResult
from pipelines.metrics.grasp_verdicts import Verdict
from pipelines.pictures.overlays import draw_overlay
from pipelines.storage.images import encode_image

NUM_FRAMES = 6  # number of our best frames, and of our worst frames
NUM_OF_OTHERS = 2  # number of worst frames of each other row
WIDTH = 640  # pixels, of a picture
JPEG_QUALITY = 80
MARGIN = 0.1  # of the image, around the objects
SMALLEST_WINDOW = 0.4  # of the image
TAG_EDGE = 0.02  # share of the picture between its edge and a number
TAG_DISTANCE, SPREAD_STEPS = 44.0, 20  # pixels between the numbers of objects; steps


@dataclass(frozen=True)
class Tag:
    """One visible object of a picture: its place, and the verdict on the row's grasp."""

    name: str
    place: tuple[float, float]  # (x, y) of the middle, shares of the picture's width and height
    verdict: Verdict

    @property
    def words(self) -> str:
        """The object and the outcome of its grasp."""
        if self.verdict.reason == "held":
            return f"{self.name}: held, quality {self.verdict.quality:.2f}"
        return f"{self.name}: {self.verdict.reason}"


@dataclass(frozen=True)
class Picture:
    """One frame of the gallery: a JPEG with regions and grasps drawn onto it."""

    name: str
    split: str
    quality: float
    jpeg: bytes
    size: tuple[int, int]
    tags: list[Tag]

    @property
    def source(self) -> str:
        """The JPEG as a data URL, the source of an image in a page."""
        return f"data:image/jpeg;base64,{b64encode(self.jpeg).decode('ascii')}"


@dataclass(frozen=True)
class Gallery:
    """The pictures of a report: our best and worst, and by title the worst of other rows."""

    best: list[Picture] = field(default_factory=list)
    worst: list[Picture] = field(default_factory=list)
    others: dict[str, list[Picture]] = field(default_factory=dict)


@dataclass
class FrameChoice:
    """The best and the worst frame of each scene by the grasps of a row, scene by scene."""

    row: str = OURS
    best: list[FrameRecord] = field(default_factory=list)
    worst: list[FrameRecord] = field(default_factory=list)

    def add(self, records: list[FrameRecord]) -> None:
        """Add the frames of one scene."""
        scored = [
            each for each in records if self.row in each.rows and each.rows[self.row].verdicts
        ]
        if scored:
            self.best += self._best_first(scored)[:1]
            self.worst += self._worst_first(scored)[:1]

    def chosen(self, count: int = NUM_FRAMES) -> tuple[list[FrameRecord], list[FrameRecord]]:
        """Return the `count` best and the `count` worst frames, no frame twice."""
        worst = self._worst_first(self.worst)[:count]
        shown = {each.name for each in worst}
        best = [each for each in self._best_first(self.best) if each.name not in shown]
        return best[:count], worst

    def _best_first(self, records: list[FrameRecord]) -> list[FrameRecord]:
        return sorted(records, key=lambda each: (-mean_quality(each, self.row), each.name))

    def _worst_first(self, records: list[FrameRecord]) -> list[FrameRecord]:
        return sorted(records, key=lambda each: (mean_quality(each, self.row), each.name))


def mean_quality(record: FrameRecord, row: str) -> float:
    """Return the mean quality of a row's grasps on the visible objects of a frame."""
    return float(np.mean([verdict.quality for verdict in record.rows[row].verdicts]))


def draw_gallery(
    choices: Mapping[str, FrameChoice], paths: Mapping[str, Path], root: GraspNetRoot
) -> tuple[Gallery, dict[str, str]]:
    """Return the gallery, and frames that cannot be drawn: frame to a sentence with the reason.

    `choices` and `paths` (of each grasps.h5): by row, including ours.
    """
    try:
        names = {o.object_id: o.name for o in object_list.read(root.root / "objects.json")}
    except SymgraspError:  # only synthesized datasets have a list of objects
        names = {}
    faults: dict[str, str] = {}

    def drawn(row: str, records: list[FrameRecord]) -> list[Picture]:
        listed, pictures = read_index(paths[row]).dataset_names(paths[row]), []
        for record in records:
            try:
                result = next(read_results(paths[row], [listed.index(record.name)]))
                pictures.append(_picture(record, row, result, root, names))
            except (SymgraspError, OSError) as error:
                faults[record.name] = f"not in the gallery: {error}"
        return pictures

    best, worst = (drawn(OURS, records) for records in choices[OURS].chosen())
    others = {
        report_row(row).title: drawn(row, choices[row].chosen(NUM_OF_OTHERS)[1])
        for row in ordered_rows(choices)
        if row != OURS
    }
    return Gallery(best, worst, others), faults


def _picture(
    record: FrameRecord, row: str, result: FrameResult, root: GraspNetRoot, names: Mapping[int, str]
) -> Picture:
    """Return a frame with the grasps of a row, `result`; `names`: of objects."""
    files = root.frame(record.name)
    label = root.read_label(files)
    verdicts = record.rows[row].verdicts
    masks = [label == verdict.object_id + 1 for verdict in verdicts]
    window = _window(np.any(masks, axis=0))
    shown = draw_overlay(root.read_frame(files), result, window, WIDTH)
    size = (WIDTH, len(shown))
    places = _spread([_middle(mask, window) for mask in masks], size)
    tags = [
        Tag(names.get(v.object_id, f"object {v.object_id:03d}"), place, v)
        for v, place in zip(verdicts, places, strict=True)
    ]
    jpeg = encode_image(shown, ".jpg", JPEG_QUALITY)
    return Picture(record.name, record.split, mean_quality(record, row), jpeg, size, tags)


def _window(objects: Mask) -> tuple[int, int, int, int]:
    """Return x0, y0, x1, y1 of a window around `objects`, with the aspect of the image."""
    height, width = objects.shape
    v, u = np.nonzero(objects)
    if not len(v):
        return 0, 0, width, height
    needed = max(np.ptp(u) / width, np.ptp(v) / height) + 2 * MARGIN
    share = min(1.0, max(needed, SMALLEST_WINDOW))
    across, down = round(share * width), round(share * height)
    left = int(np.clip((u.min() + u.max() - across) // 2, 0, width - across))
    top = int(np.clip((v.min() + v.max() - down) // 2, 0, height - down))
    return left, top, left + across, top + down


def _middle(mask: Mask, window: tuple[int, int, int, int]) -> tuple[float, float]:
    """Return (x, y) of the pixel of `mask` nearest to the mask's mean, as shares of the window."""
    v, u = np.nonzero(mask)
    if not len(v):
        return 0.5, 0.5
    nearest = int(np.argmin((v - v.mean()) ** 2 + (u - u.mean()) ** 2))
    left, top, right, bottom = window
    return (u[nearest] + 0.5 - left) / (right - left), (v[nearest] + 0.5 - top) / (bottom - top)


def _spread(places: list[tuple[float, float]], size: tuple[int, int]) -> list[tuple[float, float]]:
    """Return `places` moved apart, so that the numbers written there do not hide each other."""
    moved = np.array(places, np.float64).reshape(-1, 2) * size
    for _ in range(SPREAD_STEPS):
        apart = moved[:, None] - moved[None]
        distance = np.linalg.norm(apart, axis=2)
        near = (distance < TAG_DISTANCE) & (distance > 0.0)
        push = (TAG_DISTANCE - distance) / 2.0 / np.where(near, distance, np.inf)
        moved += (push[:, :, None] * apart).sum(axis=1)
    return [(float(x), float(y)) for x, y in np.clip(moved / size, TAG_EDGE, 1.0 - TAG_EDGE)]
