"""Regions and symmetries of real frames against masks drawn, and symmetries seen, by a person."""

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipelines import infer
from pipelines.batch import BatchOptions
from pipelines.configs import InferConfig
from pipelines.formats import grasps_file
from pipelines.geometry.transforms import unit

FRAMES = Path(__file__).parents[3] / "shared" / "frames"
SOURCES = ("mosd", "m2t2_realsense", "zerograsp_stereo", "6dofgraspnet_realsense")
MIN_PIXELS = 400  # smaller instances are left out
WITHIN = np.radians(10.0)

pytestmark = pytest.mark.skipif(not FRAMES.is_dir(), reason=f"{FRAMES} is not there")


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


def instances_of(source, folder):
    """Every labelled instance of a folder of frames, as `infer` with default weights sees it."""
    output = folder / f"{source}.h5"
    paths = infer.InferPaths(FRAMES / source, output)
    infer.run(paths, InferConfig(), BatchOptions(progress=False))
    seen = json.loads((FRAMES / "symmetry_by_eye.json").read_text())["frames"]
    facts = {
        f"{f['source']}/{f['name']}": f for f in json.loads((FRAMES / "frames.json").read_text())
    }
    results = grasps_file.read(output).results()
    for key in (key for key in seen if key.startswith(source)):
        result = next(r for r in results if key.split("/")[1] in r.name)
        masks = [result.regions.mask(i, *result.size) for i in range(len(result.regions))]
        label = cv2.imread(str(FRAMES / f"{key}_label.png"), cv2.IMREAD_UNCHANGED)
        up = unit(np.array(facts[key]["table_plane_auto"]["n"]))
        for number in np.unique(label[label > 0]).tolist():
            mask, said = label == number, seen[key].get(str(number), {})
            if mask.sum() < MIN_PIXELS:
                continue
            overlap = [(mask & each).sum() / (mask | each).sum() for each in masks]
            best = int(np.argmax(overlap))
            yield Instance(
                f"{key}#{number}",
                said.get("shape", ""),
                bool(said.get("upright")),
                said.get("symmetry", ""),
                float(overlap[best]),
                np.asarray(result.regions.symmetry_direction[best], np.float64),
                up,
            )


@pytest.fixture(scope="module")
def instances(tmp_path_factory):
    folder = tmp_path_factory.mktemp("frames")
    return [each for source in SOURCES for each in instances_of(source, folder)]


def share(right):
    missed = [name for name, good in right.items() if not good]
    return len(right) - len(missed), f"{len(right) - len(missed)} of {len(right)}, missed {missed}"


def test_four_of_five_instances_are_regions(instances):
    count, told = share({each.name: each.overlap >= 0.5 for each in instances})
    assert len(instances) == 38
    assert count >= 0.8 * len(instances), told


def test_four_of_five_upright_axes_stand_on_the_table(instances):
    upright = [each for each in instances if each.kind == "rotation" and each.upright]
    cosine = {each.name: abs(float(each.direction[3] @ each.up)) for each in upright}
    count, told = share({name: value > np.cos(WITHIN) for name, value in cosine.items()})
    assert len(upright) == 10
    assert count >= 0.8 * len(upright), told


def test_four_of_five_boxes_have_an_upright_plane(instances):
    boxes = [each for each in instances if each.shape.startswith("box")]
    lean = {each.name: np.abs(each.direction[:3] @ each.up) for each in boxes}
    count, told = share({name: (value < np.sin(WITHIN)).any() for name, value in lean.items()})
    assert len(boxes) == 13
    assert count >= 0.8 * len(boxes), told
