"""One observation of a frame for all planners of grasps."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pipelines.configs import InferConfig
from pipelines.evaluation import baselines
from pipelines.evaluation.baselines import Baselines
from pipelines.frames.frames import find_frames
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.health.golden import FRAMES
from pipelines.inference import frame_grasps, models
from pipelines.inference.frame_grasps import Planner
from pipelines.inference.observation import observe


@pytest.fixture(scope="module")
def sparse_frame():
    """The bundled frame table_1 without 60 % of its pixels."""
    (source,) = [each for each in find_frames(FRAMES) if each.name == "table_1"]
    frame = source.read()
    missing = np.random.default_rng(0).random(frame.depth.shape) < 0.6
    return replace(frame, depth=np.where(missing, 0, frame.depth).astype(np.float32))


def observed_by(module, monkeypatch, call):
    """The only observation that `module` makes in `call()`."""
    made = []

    def remember(*args, **kwargs):
        made.append(observe(*args, **kwargs))
        return made[-1]

    monkeypatch.setattr(module, "observe", remember)
    call()
    (seen,) = made
    return seen


def test_infer_and_the_baselines_see_the_same_regions_and_points_of_sparse_depth(
    sparse_frame, monkeypatch
):
    gripper, results = load_gripper("rg2"), []
    detector = models.detector(models.DETECTOR_WEIGHTS, "cpu")
    planner = Planner(InferConfig(method="planar"), gripper, detector)
    infer = observed_by(
        frame_grasps,
        monkeypatch,
        lambda: results.append(planner.plan(sparse_frame, np.random.default_rng(0))),
    )
    (result,) = results
    masks = [result.regions.mask(i, *result.size) for i in range(len(result.regions))]
    root = SimpleNamespace(read_frame=lambda files: sparse_frame)
    others = Baselines(SimpleNamespace(root=root), gripper, InferConfig())
    owners = SimpleNamespace(instance=[-1] * len(masks), object_id=[-1] * len(masks))
    truth = SimpleNamespace(scene=SimpleNamespace(poses={}))
    rng = np.random.default_rng(0)
    seen = observed_by(baselines, monkeypatch, lambda: others.rows(masks, owners, None, truth, rng))

    assert len(infer.regions) == len(seen.regions) >= 5
    for own, other in zip(infer.regions, seen.regions, strict=True):
        np.testing.assert_array_equal(own.mask, other.mask)
    for own, other in zip(infer.clouds, seen.clouds, strict=True):
        np.testing.assert_array_equal(own.points, other.points)
        np.testing.assert_array_equal(own.normals, other.normals)
    for region, cloud in zip(seen.regions, seen.clouds, strict=True):
        assert len(cloud) > 0.5 * region.mask.sum()  # not only pixels with neighbours
    np.testing.assert_array_equal(infer.scene.depth, seen.scene.depth)
    np.testing.assert_array_equal(infer.scene.plane.normal, seen.scene.plane.normal)
    assert infer.scene.plane.offset == seen.scene.plane.offset
