"""Real frames with masks drawn by a person, as taken and changed in ways that keep the masks true.

A change imitates a camera with another pose, build or disturbance: a result that holds for the
frames as taken only by chance does not hold for all changes.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from pipelines import infer
from pipelines.configs import InferConfig
from pipelines.geometry.transforms import unit
from pipelines.runtime.batch import BatchOptions
from tests.grasp_files.whole_file import read_whole

FRAMES = Path(__file__).parents[3] / "shared" / "frames"
SOURCES = ("mosd", "m2t2_realsense", "zerograsp_stereo", "6dofgraspnet_realsense")
MIN_PIXELS = 400  # smaller instances are left out, in frames as taken and changed
ROLL = np.radians(20.0)
SMALLER, LARGER, NEARER = 0.75, 1.25, 0.8
NOISE, LOST = 3.6e-3, 0.04  # of the squared depth, per metre; share of the pixels
EDGE = 0.02  # metres between neighbours


@dataclass(frozen=True)
class LabelledFrame:
    """One frame: colour, depth as stored, instance numbers, and the table's normal (3,)."""

    key: str
    color: np.ndarray
    depth: np.ndarray
    label: np.ndarray
    camera: dict
    up: np.ndarray

    @property
    def stem(self) -> str:
        return self.key.replace("/", "__")

    @property
    def matrix(self) -> np.ndarray:
        camera = self.camera
        return np.array(
            [[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1.0]]
        )

    def images(self, change) -> dict:
        return {name: change(getattr(self, name)) for name in ("color", "depth", "label")}

    def with_depth(self, metres) -> "LabelledFrame":
        scaled = np.clip(metres * self.camera["depth_scale"], 0, np.iinfo(np.uint16).max)
        return replace(self, depth=scaled.round().astype(np.uint16))

    def metres(self) -> np.ndarray:
        return self.depth / self.camera["depth_scale"]

    def write(self, folder: Path) -> None:
        cv2.imwrite(str(folder / f"{self.stem}_color.png"), self.color)
        cv2.imwrite(str(folder / f"{self.stem}_depth.png"), self.depth)
        (folder / f"{self.stem}_camera.json").write_text(json.dumps(self.camera))


def as_taken(frame: LabelledFrame) -> LabelledFrame:
    return frame


def mirrored(frame: LabelledFrame) -> LabelledFrame:
    camera = {**frame.camera, "cx": frame.depth.shape[1] - 1 - frame.camera["cx"]}
    images = frame.images(lambda image: image[:, ::-1].copy())
    return replace(frame, **images, camera=camera, up=frame.up * (-1, 1, 1))


def upside_down(frame: LabelledFrame) -> LabelledFrame:
    height, width = frame.depth.shape
    middle = {"cx": width - 1 - frame.camera["cx"], "cy": height - 1 - frame.camera["cy"]}
    images = frame.images(lambda image: image[::-1, ::-1].copy())
    return replace(frame, **images, camera={**frame.camera, **middle}, up=frame.up * (-1, -1, 1))


def rolled(frame: LabelledFrame) -> LabelledFrame:
    """Turn the camera about its own axis, and move the picture so that the labels stay in it."""
    height, width = frame.depth.shape
    cos, sin = np.cos(ROLL), np.sin(ROLL)
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    homography = frame.matrix @ turn @ np.linalg.inv(frame.matrix)
    rows, columns = np.nonzero(frame.label)
    x, y, w = homography @ (columns.mean(), rows.mean(), 1)
    shift = np.array([width / 2 - x / w, height / 2 - y / w])
    moved = np.array([[1, 0, shift[0]], [0, 1, shift[1]], [0, 0, 1]]) @ homography

    def warp(image: np.ndarray) -> np.ndarray:
        return cv2.warpPerspective(image, moved, (width, height), flags=cv2.INTER_NEAREST)

    middle = {"cx": frame.camera["cx"] + shift[0], "cy": frame.camera["cy"] + shift[1]}
    camera = {**frame.camera, **middle}
    return replace(frame, **frame.images(warp), camera=camera, up=turn @ frame.up)


def fewer_pixels(frame: LabelledFrame) -> LabelledFrame:
    height, width = (round(SMALLER * side) for side in frame.depth.shape)
    scaled = {name: SMALLER * frame.camera[name] for name in ("fx", "fy", "cx", "cy")}
    camera = {**frame.camera, **scaled, "width": width, "height": height}

    def resize(image: np.ndarray) -> np.ndarray:
        return cv2.resize(image, (width, height), interpolation=cv2.INTER_NEAREST)

    return replace(frame, **frame.images(resize), camera=camera)


def larger(frame: LabelledFrame) -> LabelledFrame:
    return frame.with_depth(LARGER * frame.metres())


def smaller(frame: LabelledFrame) -> LabelledFrame:
    return frame.with_depth(NEARER * frame.metres())


def mirrored_and_larger_without_edges(frame: LabelledFrame) -> LabelledFrame:
    return without_edges(larger(mirrored(frame)))


def rolled_upside_down_smaller_and_noisier_in_fewer_pixels(frame: LabelledFrame) -> LabelledFrame:
    return fewer_pixels(noisier(smaller(rolled(upside_down(frame)))))


def noisier(frame: LabelledFrame) -> LabelledFrame:
    """Add noise that neighbours share, as stereo matching makes it, and lose single pixels."""
    random, depth = np.random.default_rng(0), frame.metres()
    height, width = depth.shape
    noise = cv2.resize(random.normal(size=(height // 3 + 1, width // 3 + 1)), (width, height))
    lost = (depth == 0) | (random.random(depth.shape) < LOST)
    return frame.with_depth(np.where(lost, 0, depth + NOISE * depth**2 * noise))


def without_edges(frame: LabelledFrame) -> LabelledFrame:
    """Lose the depth wherever it jumps, five pixels wide."""
    depth, nearby = frame.metres(), np.ones((3, 3))
    jumps = cv2.dilate(depth, nearby) - cv2.erode(depth, nearby) > EDGE
    lost = cv2.dilate(jumps.astype(np.uint8), np.ones((5, 5))) > 0
    return frame.with_depth(np.where(lost, 0, depth))


CHANGES = (
    as_taken,
    mirrored_and_larger_without_edges,
    rolled_upside_down_smaller_and_noisier_in_fewer_pixels,
)


@dataclass(frozen=True)
class Instance:
    """One labelled instance and the region that covers it best."""

    name: str
    shape: str
    upright: bool
    kind: str
    overlap: float
    direction: np.ndarray  # (5, 3)
    up: np.ndarray  # (3,)


def seen_by_eye() -> dict:
    return json.loads((FRAMES / "symmetry_by_eye.json").read_text())["frames"]


def labelled_frames() -> list[LabelledFrame]:
    """Every frame of `SOURCES` whose instances a person has examined."""
    records = json.loads((FRAMES / "frames.json").read_text())
    up = {f"{each['source']}/{each['name']}": each["table_plane_auto"]["n"] for each in records}
    return [
        LabelledFrame(
            key,
            cv2.imread(str(FRAMES / f"{key}_color.png")),
            cv2.imread(str(FRAMES / f"{key}_depth.png"), cv2.IMREAD_UNCHANGED),
            cv2.imread(str(FRAMES / f"{key}_label.png"), cv2.IMREAD_UNCHANGED),
            json.loads((FRAMES / f"{key}_camera.json").read_text()),
            unit(np.array(up[key])),
        )
        for key in seen_by_eye()
        if key.split("/")[0] in SOURCES
    ]


def instances_of(change: Callable[[LabelledFrame], LabelledFrame], folder: Path) -> list[Instance]:
    """Every labelled instance of the changed frames, as found by `infer` with default weights."""
    frames, seen = [change(frame) for frame in labelled_frames()], seen_by_eye()
    (folder / "frames").mkdir()
    for frame in frames:
        frame.write(folder / "frames")
    paths = infer.InferPaths(folder / "frames", folder / "grasps.h5")
    infer.run(paths, InferConfig(), BatchOptions(progress=False))
    results = read_whole(paths.output).results
    return [
        instance
        for frame in frames
        for result in results
        if frame.stem in result.name
        for instance in found(frame, result, seen[frame.key])
    ]


def found(frame: LabelledFrame, result, seen: dict) -> list[Instance]:
    masks = [result.regions.mask(i, *result.size) for i in range(len(result.regions))]
    instances = []
    for number in np.unique(frame.label[frame.label > 0]).tolist():
        mask, noted = frame.label == number, seen.get(str(number), {})
        if mask.sum() < MIN_PIXELS:
            continue
        overlap = [(mask & each).sum() / (mask | each).sum() for each in masks]
        best = int(np.argmax(overlap))
        direction = np.asarray(result.regions.symmetry_direction[best], np.float64)
        truth = noted.get("shape", ""), bool(noted.get("upright")), noted.get("symmetry", "")
        name = f"{frame.key}#{number}"
        instances.append(Instance(name, *truth, float(overlap[best]), direction, frame.up))
    return instances
