"""`infer` finds an output that cannot be written before it loads a model."""

import pytest

from pipelines import infer
from pipelines.configs import InferConfig
from pipelines.errors import SymgraspError
from pipelines.grasp_files import grasps_file
from pipelines.inference.runs.run_settings import InferPaths
from pipelines.runtime.batch import BatchOptions
from tests.geometry.tabletops import Box
from tests.stages.test_infer import write_frame


def test_an_output_that_cannot_be_written_is_refused_before_the_models_are_loaded(
    tmp_path, monkeypatch
):
    write_frame(tmp_path / "frames", "a", [Box((0.05, 0.05, 0.05))])
    loaded = []
    monkeypatch.setattr(infer, "load_in_workers", lambda *_: loaded.append(1))
    output = tmp_path / "g.h5"
    grasps_file.parts_folder(output).write_text("in the way")
    config = InferConfig(method="planar", regions="geometric")
    with pytest.raises(SymgraspError, match="is a file"):
        infer.run(InferPaths(tmp_path / "frames", output), config, BatchOptions(progress=False))
    assert not loaded
