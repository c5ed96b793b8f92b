"""The truth as a prediction: the oracle's grasps, judged as ours, score as the oracle row."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipelines import evaluate
from pipelines.configs import EvaluateConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.evaluation.baselines import Baselines
from pipelines.evaluation.frame_scores import assign_regions
from pipelines.evaluation.predictions import FramePredictions
from pipelines.evaluation.reports import reports
from pipelines.evaluation.truth import TruthReader
from pipelines.grasp_files.grasps_tables import FrameResult
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.grasps import GraspPoses
from pipelines.runtime.batch import BatchOptions
from tests.stages.toy_root import frame_names, grasp_table, true_result, write_grasps, write_root

CONFIG = EvaluateConfig(min_visible_pixels=100, gripper="rg2")
SEED = 3


def planned_by_the_oracle(root: GraspNetRoot, name: str) -> FrameResult:
    """The truth's regions and symmetries with the grasps that the oracle row plans on them."""
    result, files = true_result(root, name), root.frame(name)
    reader = TruthReader(root, CONFIG)
    truth, predictions = reader.read(files), FramePredictions.from_result(result)
    owners = assign_regions(predictions.masks, truth, CONFIG)
    rng = np.random.default_rng([SEED, files.scene_id, files.frame_id])
    baselines = Baselines.of(reader, load_gripper("rg2"))
    row = baselines.rows(predictions.masks, owners, files, truth, rng)["oracle"]
    regions = np.flatnonzero([len(best) for best in row.best])
    table = grasp_table(GraspPoses.concatenate([row.best[region] for region in regions]))
    scores = np.array(row.rank_score)[regions]
    return replace(result, grasps=replace(table, region=regions, rank_score=scores))


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> dict:
    folder: Path = tmp_path_factory.mktemp("oracle")
    root = write_root(folder / "root")
    results = [planned_by_the_oracle(root, name) for name in frame_names()]
    write_grasps(folder / "grasps.h5", results)
    options = BatchOptions(progress=False)
    output = folder / "report.json"
    evaluate.run(
        folder / "grasps.h5", root.root, output, CONFIG, options, baselines=True, seed=SEED
    )
    return reports.read_report(output)["rows"]


@pytest.mark.parametrize("figure", ["grasp_quality", "antipodal_score", "antipodal_score_region"])
def test_the_oracles_grasps_score_as_the_oracle_row(rows, figure):
    assert rows["oracle"]["all"][figure] > 0.3
    assert rows["ours"]["all"][figure] == pytest.approx(rows["oracle"]["all"][figure], abs=1e-4)


def test_grasps_have_the_same_outcomes(rows):
    assert rows["ours"]["all"]["reasons"] == rows["oracle"]["all"]["reasons"]


def test_true_symmetries_and_masks_have_every_average_precision_one(rows):
    assert set(rows["ours"]["all"]["symmetry_ap"].values()) == {1.0}
    assert rows["ours"]["all"]["mask_ap50"] == 1.0
