"""`view`: a page for each frame and an index; resumable, with separate faults."""

import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

from pipelines import infer, view
from pipelines.configs import InferConfig, ViewConfig
from pipelines.errors import FormatError, StaleOutputError, SymgraspError, UnknownNameError
from pipelines.frames.frames_record import FramesRecord
from pipelines.grasp_files import grasps_file
from pipelines.grasp_files.grasps_tables import FrameResult
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.runtime.batch import BatchOptions, StageReport
from pipelines.storage.files import write_json
from pipelines.storage.images import read_image, write_image
from pipelines.storage.provenance import digest_folder, make_stamp, write_sidecar
from symgrasp_cli.app import app
from tests.evaluation.page_reader import Reader
from tests.geometry.tabletops import Box
from tests.pictures.grasp_page.toys import decoded, scene_of, toy_frame, toy_result
from tests.stages.test_infer import write_frame

CONFIG, OPTIONS = ViewConfig(), BatchOptions(progress=False)
FRAME, INDEX = toy_frame("a")
STAMP = make_stamp("infer", {"gripper": "franka"})
NAMES = ("one/a", "one/b", "two/c")


def result(name: str, grasps: int = 5, seed: int = 0) -> FrameResult:
    return replace(toy_result(FRAME, INDEX, grasps, seed), name=name)


def write_results(path: Path, results: list[FrameResult], frames: Path | None = None) -> Path:
    recorded = {} if frames is None else FramesRecord(frames).beside(path)
    grasps_file.write(path, results, replace(STAMP, recorded=recorded))
    return path


@pytest.fixture
def grasps(tmp_path: Path) -> Path:
    """Three frames, the second of them without grasps, and their file."""
    for name in NAMES:
        (tmp_path / "frames" / name).parent.mkdir(parents=True, exist_ok=True)
        write_frame(tmp_path / "frames" / name[:3], name[4:], [Box((0.05, 0.05, 0.05))])
    results = [result(NAMES[0]), result(NAMES[1], 0), result(NAMES[2], seed=1)]
    return write_results(tmp_path / "grasps.h5", results, tmp_path / "frames")


def run(grasps: Path, out: Path, *, config=CONFIG, options=OPTIONS, frames=None) -> StageReport:
    return view.run(view.ViewPaths(grasps, out, frames), config, options)


def page_of(out: Path, name: str) -> str:
    return (out / "frames" / f"{name}.html").read_text(encoding="utf-8")


def test_every_frame_has_a_page_of_its_own_grasps_and_points(grasps, tmp_path):
    report = run(grasps, tmp_path / "out")
    assert (report.done, report.exit_code) == (list(NAMES), 0)
    for found, seed in ((NAMES[0], 0), (NAMES[2], 1)):
        scene = scene_of(page_of(tmp_path / "out", found))
        table = result(found, seed=seed).grasps
        np.testing.assert_array_equal(decoded(scene["arrays"]["translation"]), table.translation)
        boxes = load_gripper("franka").boxes(table.width)  # the gripper of the grasps
        np.testing.assert_allclose(decoded(scene["arrays"]["boxes"]), boxes, atol=1e-6)
        stored = read_image(tmp_path / "frames" / f"{found}_depth.png") / 10000.0
        depth = decoded(scene["arrays"]["depth"]) * scene["depth_step"]
        assert np.abs(depth - stored).max() < scene["depth_step"]
    empty = page_of(tmp_path / "out", NAMES[1])
    assert "empty: nothing stands out" in empty
    assert scene_of(empty)["sources"] == []


def test_the_index_lists_all_frames_with_pictures_that_are_there(grasps, tmp_path):
    out = tmp_path / "out"
    run(grasps, out)
    reader = Reader((out / "index.html").read_text(encoding="utf-8"))
    links = [a["href"] for tag, a in reader.found if tag == "a"]
    pictures = [a["src"] for tag, a in reader.found if tag == "img"]
    assert links == [f"frames/{name}.html" for name in NAMES]
    for path in (*links, *pictures):
        assert (out / path).is_file()
    assert read_image(out / pictures[0]).shape[1] == CONFIG.picture_width
    assert "empty: nothing stands out" in reader.text


def test_frames_that_cannot_be_shown_are_named_and_the_rest_is_done(grasps, tmp_path):
    results = [
        result("one/a"),
        FrameResult("one/b", "failed", "its depth is torn"),
        result("two/c"),
        result("two/gone"),
        result("../../out_of_it"),
    ]
    write_results(grasps, results, tmp_path / "frames")
    torn = tmp_path / "frames/two/c_color.png"
    torn.write_bytes(torn.read_bytes()[:-20])
    out = tmp_path / "out"
    report = run(grasps, out)
    assert report.done == ["one/a"]
    assert report.exit_code == 1
    reasons = {
        "one/b": "torn",
        "two/c": "cut off",
        "two/gone": "--frames",
        "../../out_of_it": "name",
    }
    assert set(report.failed) == set(reasons)
    assert all(words in report.failed[name] for name, words in reasons.items())
    assert sorted(path.name for path in out.rglob("*.html")) == ["a.html", "index.html"]
    reader = Reader((out / "index.html").read_text(encoding="utf-8"))
    assert all(sentence in reader.text for sentence in report.failed.values())
    assert not list(tmp_path.glob("out_of_it*"))


def test_a_frame_with_a_row_that_is_no_grasp_fails_alone(grasps, tmp_path):
    broken = result("one/a")
    broken.grasps.rotation[0] = 0.0
    write_results(grasps, [broken, result("two/c")], tmp_path / "frames")
    report = run(grasps, tmp_path / "out")
    assert report.done == ["two/c"]
    assert report.failed == {"one/a": "the rotation of a grasp is no rotation; run infer again"}


def test_a_damaged_frame_is_named_and_the_others_have_pages(grasps, tmp_path):
    with h5py.File(grasps, "r+") as file:
        file["grasps/region"][0] = 99
    report = run(grasps, out := tmp_path / "out")
    assert report.done == list(NAMES[1:])
    assert "is damaged (region of a grasp" in report.failed[NAMES[0]]
    reader = Reader((out / "index.html").read_text(encoding="utf-8"))
    links = [a["href"] for tag, a in reader.found if tag == "a"]
    assert links == [f"frames/{name}.html" for name in NAMES[1:]]
    assert report.failed[NAMES[0]] in reader.text


def test_grasps_of_images_of_another_size_are_refused(grasps, tmp_path):
    half = tmp_path / "half"
    (half / "one").mkdir(parents=True)
    write_frame(half / "one", "a", [])
    for kind in ("color", "depth"):
        path = half / "one" / f"a_{kind}.png"
        write_image(path, read_image(path)[::2, ::2])
    facts = dict(fx=131, fy=131, cx=80, cy=60, depth_scale=10000.0)
    write_json(half / "one/a_camera.json", facts)
    report = run(grasps, tmp_path / "out", frames=half)
    assert "is 160x120, but its grasps are of 320x240" in report.failed["one/a"]
    assert report.failed["two/c"] == f"{half} has no frame two/c; give the folder that infer read"


def test_a_second_run_skips_pages_and_makes_only_changed_frames_again(grasps, tmp_path):
    out = tmp_path / "out"
    run(grasps, out)
    before = {path: path.stat().st_mtime_ns for path in (out / "frames").rglob("*")}
    assert run(grasps, out).skipped == list(NAMES)
    assert before == {path: path.stat().st_mtime_ns for path in (out / "frames").rglob("*")}
    (out / "frames/two/c.html").unlink()  # as after a killed run
    assert run(grasps, out).done == ["two/c"]
    more = [result(NAMES[0]), result(NAMES[1], 0), result(NAMES[2], seed=2)]
    write_results(grasps, more, tmp_path / "frames")
    report = run(grasps, out)
    assert report.skipped == list(NAMES[:2])
    assert "--overwrite" in report.failed["two/c"]
    listed = (out / "index.html").read_text(encoding="utf-8")
    assert 'href="frames/two/c.html"' in listed  # the page is still there
    assert view.STALE in listed
    assert run(grasps, out, options=replace(OPTIONS, overwrite=True)).done == list(NAMES)


def test_an_index_without_a_single_page_is_not_written(grasps, tmp_path):
    out = tmp_path / "out"
    failed = write_results(tmp_path / "failed.h5", [FrameResult("one/a", "failed", "torn")])
    assert run(failed, out, frames=tmp_path / "frames").exit_code == 1
    assert not out.exists()
    run(grasps, out)
    index = (out / "index.html").read_text()
    more = [result(name, seed=place + 5) for place, name in enumerate(NAMES)]
    write_results(grasps, more, tmp_path / "frames")
    assert set(run(grasps, out).failed) == set(NAMES)
    assert (out / "index.html").read_text() == index  # still of the pages that are there


def test_a_lost_picture_is_drawn_again_with_its_page(grasps, tmp_path):
    out = tmp_path / "out"
    run(grasps, out)
    picture = out / "frames/two/c.jpg"
    drawn, page = picture.read_bytes(), page_of(out, "two/c")
    picture.unlink()
    report = run(grasps, out)
    assert (report.done, report.skipped) == (["two/c"], list(NAMES[:2]))
    assert (picture.read_bytes(), page_of(out, "two/c")) == (drawn, page)


def test_a_new_frame_leaves_the_pages_of_the_others(grasps, tmp_path):
    results = [result(NAMES[0]), result(NAMES[1], 0)]
    first = write_results(tmp_path / "first.h5", results, tmp_path / "frames")
    run(first, tmp_path / "out")
    report = run(grasps, tmp_path / "out")
    assert (report.skipped, report.done) == (list(NAMES[:2]), ["two/c"])


def test_other_settings_and_other_folders_are_refused(grasps, tmp_path):
    run(grasps, tmp_path / "out")
    with pytest.raises(StaleOutputError):
        run(grasps, tmp_path / "out", config=ViewConfig(max_pixels=5000))
    with pytest.raises(UnknownNameError):
        run(grasps, tmp_path / "new", config=ViewConfig(gripper="claw"))
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/index.html").write_text("my own page")
    with pytest.raises(SymgraspError, match="no output of view"):
        run(grasps, tmp_path / "mine", options=replace(OPTIONS, overwrite=True))
    assert (tmp_path / "mine/index.html").read_text() == "my own page"
    (tmp_path / "file").write_text("x")
    with pytest.raises(SymgraspError, match="is a file"):
        run(grasps, tmp_path / "file")


def test_two_workers_write_the_same_bytes_and_a_dry_run_writes_none(grasps, tmp_path):
    dry = run(grasps, tmp_path / "dry", options=replace(OPTIONS, dry_run=True))
    assert len(dry.notes) == 3
    assert not (tmp_path / "dry").exists()
    run(grasps, tmp_path / "one")
    run(grasps, tmp_path / "two", options=replace(OPTIONS, workers=2))
    digests = {digest_folder(tmp_path / out, "**/*.*") for out in ("one", "two")}
    assert len(digests) == 1


def test_frames_are_found_where_infer_read_them_or_in_a_given_folder(grasps, tmp_path):
    (tmp_path / "frames").rename(tmp_path / "moved")
    with pytest.raises(FormatError, match="--frames"):
        run(grasps, tmp_path / "out")
    assert run(grasps, tmp_path / "out", frames=tmp_path / "moved").done == list(NAMES)
    unsaid = write_results(tmp_path / "old.h5", [result("one/a")])
    with pytest.raises(FormatError, match="--frames"):
        run(unsaid, tmp_path / "new")


def test_frames_that_changed_since_infer_read_them_are_noted(tmp_path):
    frames, grasps, out = (tmp_path / name for name in ("frames", "grasps.h5", "out"))
    write_frame(frames, "a", [Box((0.05, 0.05, 0.05))])
    config = InferConfig(regions="geometric", method="random")
    infer.run(infer.InferPaths(frames, grasps), config, OPTIONS)
    assert "frames" not in run(grasps, out).notes
    write_frame(frames, "a", [Box((0.05, 0.05, 0.09))])
    assert "others than those that infer read" in run(grasps, out).notes["frames"]


def test_a_recording_for_rerun_is_added_to_finished_pages(grasps, tmp_path, monkeypatch):
    out = tmp_path / "out"
    run(grasps, out)
    paths = view.ViewPaths(grasps, out)
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(SymgraspError, match="pip install"):
        view.run(paths, CONFIG, OPTIONS, rerun=True)

    def write(path, frame, found, gripper, stamp):
        if frame.name == "two/c":
            raise SymgraspError("disk full")
        path.write_text(f"{frame.name} {len(found.grasps)} {gripper.name}")
        write_sidecar(path, stamp)

    monkeypatch.setattr(view, "need_rerun", lambda: None)
    monkeypatch.setattr(view, "write_recording", write)
    report = view.run(paths, CONFIG, OPTIONS, rerun=True)
    assert (report.done, report.failed) == (list(NAMES[:2]), {"two/c": "disk full"})
    assert (out / "frames/one/a.rrd").read_text() == "one/a 5 franka"
    assert view.run(paths, CONFIG, OPTIONS, rerun=True).skipped == list(NAMES[:2])


def test_the_command_writes_pages(grasps, tmp_path):
    arguments = ["view", str(grasps), "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0
    assert "one/a: " in done.output
    refused = CliRunner().invoke(app, [*arguments, "--gripper", "rg2"])
    assert refused.exit_code == 1
    assert "Traceback" not in refused.output
