"""The upper bound of PointNetGPD's candidates on a toy dataset."""

from benchmarks.baseline_oracles import best_qualities
from pipelines.configs import EvaluateConfig
from pipelines.evaluation.truth import TruthReader
from tests.stages.toy_root import write_root


def test_each_visible_object_has_one_quality_and_some_object_can_be_held(tmp_path):
    root = write_root(tmp_path / "root")
    frames = [files for scene in root.scenes() for files in scene.frames()]
    visible = [len(TruthReader(root, EvaluateConfig()).read(files).visible) for files in frames]
    found = [quality for split in best_qualities(root, "light").values() for quality in split]
    assert len(found) == sum(visible)
    assert all(0.0 <= quality <= 1.0 for quality in found)
    assert max(found) > 0.5
