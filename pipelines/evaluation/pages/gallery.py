"""The best and the worst frames of a report as pictures, with what became of each object.

A scene's views are much alike, so a scene gives at most its best and its worst frame. A frame is as
good as the mean quality of our grasps on its visible objects.
"""

from base64 import b64encode
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from pipelines.array_types import Mask
from pipelines.dataset import object_list
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.errors import SymgraspError
from pipelines.evaluation.records import FrameRecord
from pipelines.evaluation.rows import OURS
from pipelines.grasp_files.grasps_stream import GraspsIndex, read_results
from pipelines.metrics.grasp_verdicts import Verdict
from pipelines.pictures.overlays import draw_overlay
from pipelines.storage.images import encode_image

ROW = OURS
NUM_FRAMES = 6  # best ones, and as many worst ones
WIDTH = 640  # pixels, of a picture
JPEG_QUALITY = 80
MARGIN = 0.1  # of the image, around the objects
SMALLEST_WINDOW = 0.4  # of the image
TAG_DISTANCE, SPREAD_STEPS = 44.0, 20  # pixels between the numbers of objects


@dataclass(frozen=True)
class Tag:
    """One visible object of a picture: where it is, and what became of our grasp on it.

    Attributes:
        object_id, name: of the object.
        place: (x, y) of its middle as shares of the picture's width and height.
        verdict: on our grasp.
    """

    object_id: int
    name: str
    place: tuple[float, float]
    verdict: Verdict

    @property
    def words(self) -> str:
        """The object and what became of our grasp on it."""
        if self.verdict.reason == "held":
            return f"{self.name}: held, quality {self.verdict.quality:.2f}"
        return f"{self.name}: {self.verdict.reason}"


@dataclass(frozen=True)
class Picture:
    """One frame of the gallery: its JPEG with regions and grasps drawn onto it."""

    name: str
    split: str
    quality: float
    jpeg: bytes
    size: tuple[int, int]
    tags: list[Tag]

    @property
    def source(self) -> str:
        """The JPEG as the source of an image within a page."""
        return f"data:image/jpeg;base64,{b64encode(self.jpeg).decode('ascii')}"


@dataclass(frozen=True)
class Gallery:
    """The pictures of a report."""

    best: list[Picture] = field(default_factory=list)
    worst: list[Picture] = field(default_factory=list)


@dataclass
class FrameChoice:
    """The best and the worst frame of each scene, gathered scene by scene."""

    best: list[FrameRecord] = field(default_factory=list)
    worst: list[FrameRecord] = field(default_factory=list)

    def add(self, records: list[FrameRecord]) -> None:
        """Add the frames of one scene."""
        scored = [record for record in records if ROW in record.rows and record.rows[ROW].verdicts]
        if scored:
            self.best.append(min(scored, key=_best_first))
            self.worst.append(min(scored, key=_worst_first))

    def chosen(self, count: int = NUM_FRAMES) -> tuple[list[FrameRecord], list[FrameRecord]]:
        """Return the `count` best and the `count` worst frames, no frame twice."""
        worst = sorted(self.worst, key=_worst_first)[:count]
        shown = {record.name for record in worst}
        best = [record for record in sorted(self.best, key=_best_first) if record.name not in shown]
        return best[:count], worst


def mean_quality(record: FrameRecord) -> float:
    """Return the mean quality of our grasps on the visible objects of a frame."""
    return float(np.mean([verdict.quality for verdict in record.rows[ROW].verdicts]))


def draw_gallery(
    choice: FrameChoice, grasps: Path, index: GraspsIndex, root: GraspNetRoot
) -> tuple[Gallery, dict[str, str]]:
    """Return the gallery, and for frames that cannot be drawn the sentence that says why."""
    best, worst = choice.chosen()
    try:
        names = {o.object_id: o.name for o in object_list.read(root.root / "objects.json")}
    except SymgraspError:  # only synthesized datasets have this list
        names = {}
    faults: dict[str, str] = {}
    drawn: dict[str, Picture] = {}
    for record in (*best, *worst):
        try:
            drawn[record.name] = _draw(record, grasps, index, root, names)
        except (SymgraspError, OSError) as error:
            faults[record.name] = f"not in the gallery: {error}"
    pick = [[drawn[r.name] for r in group if r.name in drawn] for group in (best, worst)]
    return Gallery(*pick), faults


def _draw(
    record: FrameRecord, grasps: Path, index: GraspsIndex, root: GraspNetRoot, names: dict[int, str]
) -> Picture:
    files = root.frame(record.name)
    place = index.dataset_names(grasps).index(record.name)
    result = next(read_results(grasps, [place]))
    label = root.read_label(files)
    masks = [label == verdict.object_id + 1 for verdict in record.rows[ROW].verdicts]
    left, top, right, bottom = window = _window(np.any(masks, axis=0))
    picture = draw_overlay(root.read_frame(files), result)[top:bottom, left:right]
    size = (WIDTH, round(WIDTH * picture.shape[0] / picture.shape[1]))
    shown = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))
    places = _spread([_middle(mask, window) for mask in masks], size)
    tags = [
        Tag(
            verdict.object_id,
            names.get(verdict.object_id, f"object {verdict.object_id:03d}"),
            place,
            verdict,
        )
        for verdict, place in zip(record.rows[ROW].verdicts, places, strict=True)
    ]
    jpeg = encode_image(shown, ".jpg", JPEG_QUALITY)
    return Picture(record.name, record.split, mean_quality(record), jpeg, size, tags)


def _window(objects: Mask) -> tuple[int, int, int, int]:
    """Return x0, y0, x1, y1 of a part of the image, of its aspect, with room around `objects`."""
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
    """Return (x, y) of the pixel of `mask` nearest to its mean, as shares of the window."""
    v, u = np.nonzero(mask)
    if not len(v):
        return 0.5, 0.5
    nearest = int(np.argmin((v - v.mean()) ** 2 + (u - u.mean()) ** 2))
    left, top, right, bottom = window
    return (u[nearest] + 0.5 - left) / (right - left), (v[nearest] + 0.5 - top) / (bottom - top)


def _spread(places: list[tuple[float, float]], size: tuple[int, int]) -> list[tuple[float, float]]:
    """Return `places` moved apart until the numbers written there do not hide each other."""
    moved = np.array(places, np.float64).reshape(-1, 2) * size
    for _ in range(SPREAD_STEPS):
        apart = moved[:, None] - moved[None]
        distance = np.linalg.norm(apart, axis=2) + 1e-9
        near = (distance < TAG_DISTANCE) & ~np.eye(len(moved), dtype=bool)
        push = np.where(near, (TAG_DISTANCE - distance) / 2.0 / distance, 0.0)
        moved += (push[:, :, None] * apart).sum(axis=1)
    shares = np.clip(moved / size, 0.02, 0.98)
    return [(float(x), float(y)) for x, y in shares]


def _best_first(record: FrameRecord) -> tuple[float, str]:
    return -mean_quality(record), record.name


def _worst_first(record: FrameRecord) -> tuple[float, str]:
    return mean_quality(record), record.name
