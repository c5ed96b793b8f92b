"""Threads for few frames, processes for many; one sentence where a network fails to load."""

import dataclasses

import pytest

from pipelines.configs import InferConfig
from pipelines.errors import SymgraspError
from pipelines.inference.runs import frame_workers as module
from pipelines.inference.runs.frame_workers import load_in_workers, options_for_frames
from pipelines.inference.runs.run_settings import InferPaths, RunSettings
from pipelines.runtime.batch import CHOSEN, BatchOptions

OPTIONS = BatchOptions(progress=False)
UNSAID = dataclasses.replace(OPTIONS, workers=CHOSEN)


@pytest.fixture
def cores(monkeypatch):
    monkeypatch.setattr(module, "cpu_count", lambda: 4)


@pytest.mark.usefixtures("cores")
@pytest.mark.parametrize(("frames", "backend", "workers"), [(15, "threading", 4), (16, "loky", 2)])
def test_many_frames_get_two_processes_unless_a_number_is_set(frames, backend, workers):
    found = options_for_frames(UNSAID, frames, "cpu")
    assert (found.backend, found.workers) == (backend, workers)
    assert options_for_frames(OPTIONS, frames, "cpu").backend == "threading"
    several = dataclasses.replace(OPTIONS, workers=3)
    assert options_for_frames(several, frames, "cpu") == several
    many = dataclasses.replace(OPTIONS, workers=100)
    assert options_for_frames(many, frames, "cpu").workers == frames
    cluster = dataclasses.replace(UNSAID, backend="dask")
    assert options_for_frames(cluster, frames, "cpu") == cluster


@pytest.mark.usefixtures("cores")
@pytest.mark.parametrize(("frames", "most", "workers"), [(500, 3, 3), (500, 9, 4), (24, 9, 3)])
def test_more_processes_are_chosen_where_cores_memory_and_frames_allow(frames, most, workers):
    roomy = dataclasses.replace(UNSAID, most_chosen=most)
    assert options_for_frames(roomy, frames, "cpu").workers == workers


@pytest.mark.usefixtures("cores")
def test_a_gpu_is_used_by_one_process():
    assert options_for_frames(UNSAID, 500, "cuda:0").backend == "threading"


def test_one_core_processes_one_frame_after_the_other(monkeypatch):
    monkeypatch.setattr(module, "cpu_count", lambda: 1)
    found = options_for_frames(UNSAID, 500, "cpu")
    assert (found.backend, found.workers) == ("threading", 1)


@pytest.mark.parametrize(
    ("backend", "config", "model"),
    [
        ("threading", InferConfig(), "network"),
        # Processes would load torch first, so they are given a critic, which needs no torch.
        ("loky", InferConfig(regions="geometric", method="symmetry-icp"), "grasp_critic"),
    ],
)
def test_a_network_that_does_not_load_is_reported_before_any_frame(
    tmp_path, backend, config, model
):
    (tmp_path / "w.safetensors").write_bytes(b"no weights")
    paths = InferPaths(tmp_path, tmp_path / "g.h5", **{model: tmp_path / "w.safetensors"})
    settings = RunSettings(paths, config, 0, "cpu", timings=False)
    with pytest.raises(SymgraspError, match=r"w\.safetensors"):
        load_in_workers(settings, dataclasses.replace(OPTIONS, workers=2, backend=backend))
