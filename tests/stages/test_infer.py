"""Stage `infer` on small synthetic frames: one file out, resumable, faults one by one."""

import dataclasses
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch

from pipelines import infer
from pipelines.configs import (
    InferConfig,
    LimitsConfig,
    RankingConfig,
    SelectionConfig,
    SymmetryConfig,
)
from pipelines.errors import (
    MissingInputError,
    StaleOutputError,
    SymgraspError,
    UnknownNameError,
    WriteError,
)
from pipelines.frames.frames import find_frames
from pipelines.grasp_files import grasps_file
from pipelines.inference.models import GRASP_CRITIC_WEIGHTS
from pipelines.inference.runs import infer_run
from pipelines.inference.runs.run_settings import RunSettings
from pipelines.runtime.batch import BatchOptions
from pipelines.storage import provenance
from pipelines.storage.files import write_json
from pipelines.storage.h5_files import new_h5
from pipelines.storage.images import read_image, write_image
from pipelines.storage.provenance import make_stamp
from tests.geometry.tabletops import CAMERA, Box, Can, render
from tests.grasp_files.whole_file import read_whole

CONFIG = InferConfig(regions="geometric", method="planar")
OPTIONS = BatchOptions(progress=False)
SHAPES = {
    "a": [Box((0.06, 0.09, 0.1))],
    "b": [Can(0.035, 0.12), Box((0.05, 0.05, 0.05), (0.15, 0, 0))],
    "c": [],
}


def write_frame(folder, name, shapes):
    depth, index = render(shapes)
    color = np.zeros((*depth.shape, 3), np.uint8)
    color[...] = 90 + 40 * (index[..., None] + 1)
    write_image(folder / f"{name}_color.png", color)
    write_image(folder / f"{name}_depth.png", np.round(depth * 10000).astype(np.uint16))
    fields = ("fx", "fy", "cx", "cy", "width", "height")
    camera = {field: getattr(CAMERA, field) for field in fields} | {"depth_scale": 10000.0}
    write_json(folder / f"{name}_camera.json", camera)
    return index


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    folder = tmp_path_factory.mktemp("frames")
    for name, shapes in SHAPES.items():
        write_frame(folder, name, shapes)
    return folder


def run(frames, output, *, config=CONFIG, options=OPTIONS, overlays=None, masks=None, **settings):
    return infer.run(infer.InferPaths(frames, output, overlays, masks), config, options, **settings)


def test_every_frame_has_a_status_and_every_object_a_best_grasp(frames, tmp_path):
    report = run(frames, tmp_path / "g.h5")
    assert report.exit_code == 0
    found = read_whole(tmp_path / "g.h5")
    assert list(found.frames.name) == ["a", "b", "c"]
    assert list(found.frames.status) == ["ok", "ok", "empty"]
    np.testing.assert_array_equal(np.bincount(found.regions.frame), [1, 2])
    best = found.grasps.is_best
    np.testing.assert_array_equal(np.sort(found.grasps.region[best]), [0, 1, 2])
    assert set(found.grasps.source) == {"planar"}


def test_the_best_grasp_of_a_region_has_its_highest_rank(frames, tmp_path):
    run(frames, tmp_path / "g.h5")
    grasps = read_whole(tmp_path / "g.h5").grasps
    for region in np.unique(grasps.region):
        mine = grasps.region == region
        assert grasps.rank_score[mine & grasps.is_best] >= grasps.rank_score[mine].max() - 1e-5


def test_two_runs_write_the_same_bytes(frames, tmp_path):
    for name in ("one.h5", "two.h5"):
        run(frames, tmp_path / name)
    assert (tmp_path / "one.h5").read_bytes() == (tmp_path / "two.h5").read_bytes()


def test_several_workers_write_the_same_bytes(frames, tmp_path):
    run(frames, tmp_path / "one.h5")
    run(frames, tmp_path / "two.h5", options=dataclasses.replace(OPTIONS, workers=2))
    assert (tmp_path / "one.h5").read_bytes() == (tmp_path / "two.h5").read_bytes()


@pytest.mark.parametrize("threads", [1, 3])
def test_frames_side_by_side_on_networks_write_the_bytes_of_one_thread(frames, tmp_path, threads):
    config, before = InferConfig(), torch.get_num_threads()
    paths = infer.InferPaths(frames, tmp_path / "one.h5")
    settings = RunSettings(paths, config, 0, "cpu", timings=False)
    sources = find_frames(frames)
    with settings.one_core():
        results = [
            dataclasses.replace(
                settings.planner().plan(source.read(), np.random.default_rng(0)),
                name=source.name,
                seconds=np.nan,
            )
            for source in sources
        ]
    torch.set_num_threads(threads)
    try:
        run(frames, tmp_path / "side.h5", config=config, device="cpu")
        assert torch.get_num_threads() == threads
    finally:
        torch.set_num_threads(before)
    side = read_whole(tmp_path / "side.h5").results
    for found, expected in zip(side, results, strict=True):
        for table in ("regions", "grasps"):
            one, other = getattr(found, table), getattr(expected, table)
            for column in dataclasses.fields(one):
                np.testing.assert_array_equal(
                    getattr(one, column.name), getattr(other, column.name)
                )


@pytest.mark.parametrize("mirrored", [False, True])
def test_the_network_sees_mirror_images_if_set(frames, tmp_path, mirrored):
    paths = infer.InferPaths(frames, tmp_path / "g.h5")
    settings = RunSettings(paths, InferConfig(mirrored=mirrored), 0, "cpu", timings=False)
    assert settings.planner().predictor.mirrored == mirrored


def test_the_results_of_another_version_are_reused(frames, tmp_path, monkeypatch):
    run(frames, tmp_path / "g.h5")
    monkeypatch.setattr(provenance, "version", lambda: "9.9.9")
    assert run(frames, tmp_path / "g.h5").skipped == ["a", "b", "c"]


def test_a_second_run_skips_everything(frames, tmp_path):
    run(frames, tmp_path / "g.h5")
    before = (tmp_path / "g.h5").stat().st_mtime_ns
    report = run(frames, tmp_path / "g.h5")
    assert report.skipped == ["a", "b", "c"]
    assert (tmp_path / "g.h5").stat().st_mtime_ns == before
    assert not grasps_file.parts_folder(tmp_path / "g.h5").exists()


def test_an_output_of_other_settings_does_not_count_as_finished(frames, tmp_path):
    run(frames, tmp_path / "g.h5")
    with pytest.raises(StaleOutputError):
        run(frames, tmp_path / "g.h5", config=dataclasses.replace(CONFIG, gripper="franka"))
    again = dataclasses.replace(OPTIONS, overwrite=True)
    report = run(
        frames,
        tmp_path / "g.h5",
        config=dataclasses.replace(CONFIG, gripper="franka"),
        options=again,
    )
    assert report.done == ["a", "b", "c"]


KILLED = """
import sys, time
from pathlib import Path
from pipelines import infer
from pipelines.runtime.batch import BatchOptions
from pipelines.configs import InferConfig

step = infer.infer_frame
def slow(item, settings):
    if item.name == "b":
        time.sleep(60)
    return step(item, settings)
infer.infer_frame = slow
config = InferConfig(regions="geometric", method="planar")
paths = infer.InferPaths(Path(sys.argv[1]), Path(sys.argv[2]))
infer.run(paths, config, BatchOptions(progress=False))
"""


def test_a_killed_run_goes_on_where_it_stopped_and_ends_with_the_same_bytes(frames, tmp_path):
    output = tmp_path / "g.h5"
    part = grasps_file.part_path(output, "a")
    environment = os.environ | {"PYTHONPATH": str(Path(infer.__file__).parents[1])}
    command = [sys.executable, "-c", KILLED, str(frames), str(output)]
    with subprocess.Popen(command, env=environment) as process:
        waited = time.monotonic()
        while not part.exists() and time.monotonic() - waited < 50:
            time.sleep(0.05)
        process.send_signal(signal.SIGKILL)
    assert part.exists()
    assert not output.exists()
    report = run(frames, output)
    # Frames are processed in parallel: "c" may or may not have been finished at the kill.
    assert "a" in report.skipped
    assert "b" in report.done
    assert sorted([*report.skipped, *report.done]) == ["a", "b", "c"]
    run(frames, tmp_path / "whole.h5")
    assert output.read_bytes() == (tmp_path / "whole.h5").read_bytes()


def test_frames_that_lacked_memory_are_tried_again_and_the_bytes_are_the_same(
    frames, tmp_path, monkeypatch
):
    def without_memory(item, settings):
        if item.name == "b":
            raise MemoryError
        return infer_frame(item, settings)

    infer_frame, output = infer.infer_frame, tmp_path / "g.h5"
    monkeypatch.setattr(infer, "infer_frame", without_memory)
    report = run(frames, output)
    assert report.done == ["a", "c"]
    assert "not enough memory" in report.failed["b"]
    monkeypatch.undo()
    report = run(frames, output)
    assert (report.done, sorted(report.skipped), report.failed) == (["b"], ["a", "c"], {})
    assert not grasps_file.parts_folder(output).exists()
    run(frames, tmp_path / "whole.h5")
    assert output.read_bytes() == (tmp_path / "whole.h5").read_bytes()


@pytest.mark.parametrize("overwrite", [False, True])
def test_parts_of_other_settings_are_made_again_with_a_warning(frames, tmp_path, caplog, overwrite):
    output = tmp_path / "g.h5"
    run(frames, tmp_path / "other.h5", config=dataclasses.replace(CONFIG, gripper="franka"))
    other = read_whole(tmp_path / "other.h5")
    stamp = make_stamp("infer", {}, inputs={"weights": "other"})
    for name in ("a", "gone"):
        grasps_file.write(grasps_file.part_path(output, name), [other.results[0]], stamp)
    options = dataclasses.replace(OPTIONS, overwrite=overwrite)
    assert run(frames, output, options=options).done == ["a", "b", "c"]
    warned = "removed 2 parts of an earlier run from" in caplog.text
    assert warned == (not overwrite)


def test_damaged_parts_are_made_again(frames, tmp_path):
    whole, output = tmp_path / "whole.h5", tmp_path / "g.h5"
    run(frames, whole)
    parts = [grasps_file.part_path(output, name) for name in "ab"]
    parts[0].parent.mkdir()
    for part, result in zip(parts, read_whole(whole).results, strict=False):
        grasps_file.write(part, [result], make_stamp("infer", {}))
        part.write_bytes(part.read_bytes()[:3000])
    assert run(frames, output).done == ["a", "b", "c"]
    assert output.read_bytes() == whole.read_bytes()


@pytest.mark.parametrize("name", ["grasps", "grasps.h5"])
def test_a_second_run_finds_the_output_of_any_accepted_name(frames, tmp_path, name):
    assert run(frames, tmp_path / name).done == ["a", "b", "c"]
    assert run(frames, tmp_path / name).skipped == ["a", "b", "c"]


def test_a_bad_frame_fails_alone_with_a_sentence(tmp_path):
    folder = tmp_path / "frames"
    write_frame(folder, "good", SHAPES["a"])
    write_frame(folder, "torn", SHAPES["a"])
    torn = folder / "torn_depth.png"
    torn.write_bytes(torn.read_bytes()[: torn.stat().st_size // 2])
    report = run(folder, tmp_path / "g.h5")
    assert report.exit_code == 1
    assert "torn_depth.png" in report.failed["torn"]
    found = read_whole(tmp_path / "g.h5")
    assert list(found.frames.status) == ["ok", "failed"]
    assert "torn_depth.png" in found.frames.message[1]
    again = run(folder, tmp_path / "g.h5")
    assert again.exit_code == 1  # a run that skips all frames still reports the failed one
    assert again.skipped == ["good"]


def test_an_output_whose_frames_all_failed_does_not_block_a_run_with_other_settings(tmp_path):
    folder, output = tmp_path / "frames", tmp_path / "g.h5"
    write_frame(folder, "a", SHAPES["a"])
    (folder / "a_camera.json").write_text("{}")
    assert list(run(folder, output).failed) == ["a"]
    write_frame(folder, "a", SHAPES["a"])
    assert run(folder, output, seed=1).done == ["a"]
    with pytest.raises(StaleOutputError):
        run(folder, output, seed=2)


def settings_of(folder, output, seed=0):
    return RunSettings(infer.InferPaths(folder, output), CONFIG, seed, "auto", timings=False)


def test_finished_frames_whose_images_are_gone_are_not_deleted(tmp_path):
    folder, output = tmp_path / "frames", tmp_path / "g.h5"
    for name in ("gone", "kept"):
        write_frame(folder, name, SHAPES["a"])
    (item, _) = infer_run.InferRun(settings_of(folder, output)).items(find_frames(folder))
    infer.infer_frame(item, settings_of(folder, output))
    for path in folder.glob("gone_*"):
        path.unlink()
    with pytest.raises(SymgraspError, match="holds 1 finished frame not among"):
        run(folder, output)
    assert item.target.exists()
    overwriting = dataclasses.replace(OPTIONS, overwrite=True)
    assert run(folder, output, options=overwriting).done == ["kept"]


def test_a_dry_run_after_a_killed_run_with_other_settings_lists_its_work(tmp_path):
    folder, output = tmp_path / "frames", tmp_path / "g.h5"
    write_frame(folder, "a", SHAPES["a"])
    settings = settings_of(folder, output, seed=1)
    (item,) = infer_run.InferRun(settings).items(find_frames(folder))
    infer.infer_frame(item, settings)
    report = run(folder, output, options=dataclasses.replace(OPTIONS, dry_run=True))
    assert (report.exit_code, report.failed) == (0, {})
    assert item.target.exists()


def test_an_empty_frame_is_no_failure(tmp_path):
    write_frame(tmp_path / "frames", "bare", [])
    report = run(tmp_path / "frames", tmp_path / "g.h5")
    assert report.exit_code == 0
    assert "nothing stands out" in report.notes["bare"]


def test_the_users_masks_are_the_regions(frames, tmp_path):
    masks = tmp_path / "masks"
    for name, shapes in SHAPES.items():
        _, index = render(shapes)
        write_image(masks / f"{name}_label.png", (index + 1).astype(np.uint8))
    run(frames, tmp_path / "g.h5", masks=masks)
    found = read_whole(tmp_path / "g.h5")
    assert set(found.regions.source) == {"masks"}
    np.testing.assert_array_equal(found.regions.mask(0, 320, 240), render(SHAPES["a"])[1] == 0)


def test_frames_of_two_folders_do_not_share_a_mask(tmp_path):
    masks = tmp_path / "masks"
    for name in ("first/0", "second/0"):
        index = write_frame(tmp_path / "frames", name, SHAPES["b"])
    write_image(masks / "0.png", (index + 1).astype(np.uint8))
    write_image(masks / "second" / "0.png", (index + 1).astype(np.uint8))
    report = run(tmp_path / "frames", tmp_path / "g.h5", masks=masks)
    assert report.done == ["second/0"]
    assert "several frames end in 0" in report.failed["first/0"]


def test_masks_of_another_ratio_fail_with_both_sizes(frames, tmp_path):
    masks = tmp_path / "masks"
    for name in SHAPES:
        write_image(masks / f"{name}_label.png", np.ones((10, 20), np.uint8))
    report = run(frames, tmp_path / "g.h5", masks=masks)
    assert "has 20 x 10 pixels; the frame's depth has 320 x 240" in report.failed["a"]


def test_overlays_are_pictures_of_the_frames_and_drawn_again_when_lost(frames, tmp_path):
    pictures = tmp_path / "pictures"
    run(frames, tmp_path / "g.h5", overlays=pictures)
    drawn = (pictures / "a.png").read_bytes()
    assert read_image(pictures / "a.png").shape == (240, 320, 3)
    (pictures / "a.png").unlink()
    run(frames, tmp_path / "g.h5", overlays=pictures)
    assert (pictures / "a.png").read_bytes() == drawn


def pictures_of(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_overlays_are_drawn_of_finished_grasps(frames, tmp_path):
    run(frames, tmp_path / "whole.h5", overlays=tmp_path / "whole")
    run(frames, tmp_path / "g.h5")
    parts = [read_whole(tmp_path / "g.h5").results[0]]
    run(frames, tmp_path / "g.h5", overlays=tmp_path / "finished")
    assert pictures_of(tmp_path / "finished") == pictures_of(tmp_path / "whole")
    # The output of a killed run that drew no pictures.
    settings = RunSettings(infer.InferPaths(frames, tmp_path / "k.h5"), CONFIG, 0, "auto", False)
    (item, *_) = infer_run.InferRun(settings).items(find_frames(frames))
    grasps_file.write(item.target, [parts[0]], item.stamp)
    assert run(frames, tmp_path / "k.h5", overlays=tmp_path / "killed").skipped == ["a"]
    assert pictures_of(tmp_path / "killed") == pictures_of(tmp_path / "whole")


def test_overlays_of_another_run_are_drawn_again_and_other_pictures_are_not_touched(
    frames, tmp_path
):
    pictures = tmp_path / "pictures"
    run(frames, tmp_path / "g.h5", overlays=pictures)
    drawn, times = pictures_of(pictures), {p: p.stat().st_mtime_ns for p in pictures.iterdir()}
    run(frames, tmp_path / "g.h5", overlays=pictures)
    assert {p: p.stat().st_mtime_ns for p in pictures.iterdir()} == times
    other = dataclasses.replace(CONFIG, gripper="franka")
    run(frames, tmp_path / "other.h5", config=other, overlays=pictures)
    assert pictures_of(pictures)["a.png"] != drawn["a.png"]
    write_image(pictures / "b.png", np.zeros((4, 4), np.uint8))  # without a stamp
    run(frames, tmp_path / "g.h5", overlays=pictures)
    assert pictures_of(pictures) == drawn


def test_a_dry_run_draws_nothing(frames, tmp_path):
    run(frames, tmp_path / "g.h5")
    dry = dataclasses.replace(OPTIONS, dry_run=True)
    run(frames, tmp_path / "g.h5", overlays=tmp_path / "pictures", options=dry)
    assert not (tmp_path / "pictures").exists()


def test_a_picture_that_cannot_be_drawn_is_named_and_the_grasps_stay(frames, tmp_path, monkeypatch):
    run(frames, tmp_path / "g.h5")

    def away(folder, *stated, **options):
        def read():
            raise SymgraspError("the images are away")

        sources = find_frames(folder, *stated, **options)
        return [dataclasses.replace(sources[0], read=read), *sources[1:]]

    monkeypatch.setattr(infer_run, "find_frames", away)
    report = run(frames, tmp_path / "g.h5", overlays=tmp_path / "pictures")
    assert (list(report.failed), report.skipped) == (["a"], ["b", "c"])
    assert "has grasps but no picture: the images are away" in report.failed["a"]
    assert list(read_whole(tmp_path / "g.h5").frames.status) == ["ok", "ok", "empty"]


def test_seconds_are_written_only_on_demand(frames, tmp_path):
    run(frames, tmp_path / "without.h5")
    assert np.isnan(read_whole(tmp_path / "without.h5").frames.seconds).all()
    run(frames, tmp_path / "with.h5", timings=True)
    assert (read_whole(tmp_path / "with.h5").frames.seconds > 0).all()


def test_a_dry_run_writes_nothing(frames, tmp_path):
    report = run(frames, tmp_path / "g.h5", options=dataclasses.replace(OPTIONS, dry_run=True))
    assert len(report.notes) == 3
    assert not list(tmp_path.iterdir())


def test_missing_weights_name_the_command_that_makes_them(frames, tmp_path):
    paths = infer.InferPaths(frames, tmp_path / "g.h5", network=tmp_path / "none.safetensors")
    with pytest.raises(MissingInputError, match="symgrasp train"):
        infer.run(paths, InferConfig(regions="geometric"), OPTIONS)


@pytest.mark.parametrize("kind", ["axis", "plane"])
def test_symmetry_critics_are_needed_only_where_symmetries_are_fitted(frames, tmp_path, kind):
    missing = {f"{kind}_critic": tmp_path / "none.safetensors"}
    paths = infer.InferPaths(frames, tmp_path / "g.h5", **missing)
    config = InferConfig(regions="geometric")
    command = {"axis": "axes", "plane": "planes"}[kind]
    with pytest.raises(MissingInputError, match=f"symgrasp train-critic {command}"):
        infer.run(paths, config, OPTIONS)
    unfitted = dataclasses.replace(
        config, selection=SelectionConfig(symmetry=SymmetryConfig(is_fitted=False))
    )
    assert infer.run(paths, unfitted, OPTIONS).exit_code == 0


def test_the_grasp_critic_is_needed_only_where_it_ranks(frames, tmp_path):
    paths = infer.InferPaths(frames, tmp_path / "g.h5", grasp_critic=tmp_path / "none.safetensors")
    config = InferConfig(regions="geometric")
    with pytest.raises(MissingInputError, match="symgrasp train-critic grasps"):
        infer.run(paths, config, OPTIONS)
    as_paper = dataclasses.replace(
        config, selection=SelectionConfig(ranking=RankingConfig(by="eq8"))
    )
    assert infer.run(paths, as_paper, OPTIONS).exit_code == 0
    with pytest.raises(StaleOutputError):
        infer.run(dataclasses.replace(paths, grasp_critic=GRASP_CRITIC_WEIGHTS), config, OPTIONS)


def test_scores_are_expected_qualities_unless_grasps_are_ranked_by_eq_8(frames, tmp_path):
    scores = {}
    for ranks in ("critic", "eq8"):
        config = InferConfig(
            regions="geometric", selection=SelectionConfig(ranking=RankingConfig(by=ranks))
        )
        run(frames, tmp_path / f"{ranks}.h5", config=config)
        table = read_whole(tmp_path / f"{ranks}.h5").grasps
        scores[ranks] = table.rank_score
        assert ((table.rank_score >= 0) & (table.rank_score <= 1)).all()
        for region in np.unique(table.region):
            mine = table.rank_score[table.region == region]
            assert mine.max() == mine[table.is_best[table.region == region]].max()
    assert scores["critic"].tolist() != scores["eq8"].tolist()


WRONG_NAMES = (
    {"regions": "all"},
    {"method": "magic"},
    {"gripper": "claw"},
    {"selection": SelectionConfig(ranking=RankingConfig(by="luck"))},
)


@pytest.mark.parametrize("wrong", WRONG_NAMES)
def test_unknown_names_list_the_known_ones(frames, tmp_path, wrong):
    with pytest.raises(UnknownNameError, match="known are"):
        run(frames, tmp_path / "g.h5", config=dataclasses.replace(CONFIG, **wrong))


def test_a_folder_without_frames_is_reported_in_one_sentence(tmp_path):
    with pytest.raises(SymgraspError, match="no RGB-D frames"):
        run(tmp_path, tmp_path / "g.h5")


def limited(frames, output, workspace=None, **settings):
    config = dataclasses.replace(CONFIG, limits=LimitsConfig(**settings))
    return infer.run(infer.InferPaths(frames, output, workspace=workspace), config, OPTIONS)


def test_black_pixels_of_a_workspace_picture_are_left_out(frames, tmp_path):
    _, index = render(SHAPES["b"])
    write_image(tmp_path / "space.png", np.uint8(255) * (index == 1))
    report = limited(frames, tmp_path / "g.h5", tmp_path / "space.png")
    assert report.exit_code == 0
    found = read_whole(tmp_path / "g.h5")
    assert (found.frames.status == "ok").sum() >= 1
    mine = found.grasps.translation[found.grasps.frame == 1]
    assert len(mine) > 0
    u, v = np.round(CAMERA.project(np.asarray(mine, np.float64))).astype(int).T
    assert (index[v, u] == 1).all()
    write_image(tmp_path / "space.png", np.uint8(255) * (index == 0))
    with pytest.raises(StaleOutputError):
        limited(frames, tmp_path / "g.h5", tmp_path / "space.png")
    write_image(tmp_path / "small.png", np.zeros((4, 4), np.uint8))
    report = limited(frames, tmp_path / "h.h5", tmp_path / "small.png")
    assert set(report.failed) == set(SHAPES)
    assert all("4 x 4" in message for message in report.failed.values())


def test_a_frame_without_a_table_has_no_limits_over_it(tmp_path):
    write_frame(tmp_path / "frames", "a", SHAPES["a"])
    write_image(tmp_path / "frames" / "a_depth.png", np.zeros((240, 320), np.uint16))
    report = limited(tmp_path / "frames", tmp_path / "g.h5", approach_cone=20.0)
    assert "table" in report.failed["a"]
    with pytest.raises(UnknownNameError, match="camera, table"):
        limited(tmp_path / "frames", tmp_path / "g.h5", box_frame="base")


def test_a_result_that_cannot_be_written_does_not_mark_its_frame_as_failed(frames, tmp_path):
    output, overlays = tmp_path / "grasps.h5", tmp_path / "overlays"
    (overlays / "a.png").mkdir(parents=True)  # a folder, where a picture is wanted
    with pytest.raises(WriteError, match="cannot be written"):
        run(frames, output, overlays=overlays)
    assert not output.exists()
    assert run(frames, output).exit_code == 0
    found = {result.status for result in read_whole(output).results}
    assert "failed" not in found


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_file_that_holds_no_grasps_is_never_replaced(frames, tmp_path, overwrite):
    picture, folder, other = (tmp_path / name for name in ("picture.png", "folder", "scene.h5"))
    picture.write_bytes(b"a picture")
    folder.mkdir()
    with new_h5(other) as file:
        file.attrs["provenance"] = make_stamp("pack", {}).as_text()
    packed = other.read_bytes()
    for output in (picture, folder, other):
        with pytest.raises(SymgraspError, match=r"is no grasps\.h5; choose another output"):
            run(frames, output, options=dataclasses.replace(OPTIONS, overwrite=overwrite))
    assert (picture.read_bytes(), other.read_bytes()) == (b"a picture", packed)


def test_a_damaged_file_of_grasps_is_made_again_with_overwrite(frames, tmp_path):
    output = tmp_path / "grasps.h5"
    run(frames, output)
    whole = output.read_bytes()
    output.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(SymgraspError):
        run(frames, output)
    run(frames, output, options=dataclasses.replace(OPTIONS, overwrite=True))
    assert output.read_bytes() == whole
