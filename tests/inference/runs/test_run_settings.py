"""The planner of a run has the models that its method uses."""

from pathlib import Path

import pytest

from pipelines.configs import InferConfig
from pipelines.inference.runs.run_settings import InferPaths, RunSettings


@pytest.mark.parametrize(
    ("method", "is_fitted"), [("symmetry-icp", True), ("planar", False), ("random", False)]
)
def test_only_the_method_that_fits_symmetries_finds_them_without_a_network(method, is_fitted):
    config = InferConfig(regions="geometric", method=method)
    planner = RunSettings(InferPaths(Path(), Path()), config, 0, "cpu", timings=False).planner()
    assert planner.predictor is None
    assert (planner.symmetry_peer is not None) == is_fitted


@pytest.mark.parametrize(
    ("config", "unused"),
    [
        (InferConfig(), set()),
        (InferConfig(regions="geometric"), {"detector"}),
        (InferConfig(method="planar"), {"network", "axis critic", "plane critic", "grasp critic"}),
    ],
)
def test_weights_that_are_given_and_not_used_are_named(caplog, config, unused):
    names = "detector", "network", "axis_critic", "plane_critic", "grasp_critic"
    given = {name: Path(f"{name}.safetensors") for name in names}
    paths = InferPaths(Path(), Path())
    RunSettings(paths, config, 0, "cpu", timings=False).warn_of_unused_weights()
    assert not caplog.text
    run = RunSettings(paths.with_weights(**given), config, 0, "cpu", timings=False)
    run.warn_of_unused_weights()
    named = {each.message.rpartition(" no ")[2].removesuffix(" runs") for each in caplog.records}
    assert named == unused


def test_masks_in_other_folders_are_other_inputs(tmp_path):
    folder = tmp_path / "masks"
    (folder / "a").mkdir(parents=True)
    (folder / "a" / "0.png").write_bytes(b"mask")
    paths = InferPaths(Path(), Path(), masks=folder)
    run = RunSettings(paths, InferConfig(), 0, "cpu", timings=False)
    before = run.other_digests()
    assert run.other_digests() == before
    (folder / "a").rename(folder / "b")
    assert run.other_digests()["masks"] != before["masks"]
