"""Stage `infer --watch`: a scripted clock writes frames, so that no test waits or races."""

import dataclasses
import errno
import math
import os
import signal
import subprocess
import sys
import threading
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from functools import partial
from itertools import pairwise
from pathlib import Path

import pytest
from joblib import cpu_count
from typer.testing import CliRunner

from pipelines import infer, infer_watch
from pipelines.configs import InferConfig, WatchConfig
from pipelines.dataset.chosen_frames import ChosenFrames
from pipelines.errors import StaleOutputError, SymgraspError, WriteError
from pipelines.grasp_files import grasps_file
from pipelines.inference.runs import following
from pipelines.inference.runs.frame_workers import MAX_THREADS
from pipelines.inference.runs.watching import Clock
from pipelines.runtime.batch import BatchOptions
from symgrasp_cli.app import app
from tests.grasp_files.whole_file import read_whole
from tests.stages.test_infer import SHAPES, write_frame

CONFIG = InferConfig(regions="geometric", method="planar")
OPTIONS = BatchOptions(progress=False)
ROOT = Path(infer.__file__).parents[1]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Complete frames a, b and c, which simulated cameras copy."""
    folder = tmp_path_factory.mktemp("made")
    for name, shapes in SHAPES.items():
        write_frame(folder, name, shapes)
    return folder


class AtOnce(Executor):
    """Runs each task at once, before `submit` returns."""

    def submit(self, task, /, *arguments, **options):
        done = Future()
        done.set_result(task(*arguments, **options))
        return done


class Cell:
    """A folder that receives frames, at times of a clock that advances only by waiting."""

    def __init__(self, made, folder):
        self.made, self.output = made, folder / "g.h5"
        self.frames = folder / "frames"
        self.frames.mkdir()
        self.time, self.events, self.reported = 0.0, [], []
        self.writer = AtOnce()

    def at(self, time, action, *arguments):
        self.events.append((time, action, arguments))

    def wait(self, seconds):
        self.time += seconds
        due = [event for event in self.events if event[0] <= self.time]
        self.events = [event for event in self.events if event[0] > self.time]
        for _, action, arguments in sorted(due, key=lambda event: event[0]):
            action(*arguments)

    def write(self, name, *, as_name=None, files=("color.png", "depth.png", "camera.json")):
        for file in files:
            data = (self.made / f"{name}_{file}").read_bytes()
            (self.frames / f"{as_name or name}_{file}").write_bytes(data)

    def write_half(self, name):
        data = (self.made / f"{name}_depth.png").read_bytes()
        (self.frames / f"{name}_depth.png").write_bytes(data[: len(data) // 2])

    def remove(self, name):
        for path in self.frames.glob(f"{name}_*"):
            path.unlink()

    def report(self, frame):
        self.reported.append(frame)

    def names_reported(self):
        return [(frame.name, frame.status) for frame in self.reported]

    def follow(self, *, timeout=30.0, config=CONFIG, options=OPTIONS, masks=None, overlays=None):
        return infer_watch.run(
            infer.InferPaths(self.frames, self.output, overlays, masks),
            config,
            options,
            watch=WatchConfig(timeout=timeout),
            notify=self.report,
            clock=Clock(lambda: self.time, self.wait),
            writer=self.writer,
        )

    def infer(self, output):
        return infer.run(infer.InferPaths(self.frames, output), CONFIG, OPTIONS)

    def statuses(self):
        frames = read_whole(self.output).frames
        return dict(zip(frames.name, frames.status, strict=True))


@pytest.fixture
def cell(made, tmp_path):
    return Cell(made, tmp_path)


def test_frames_are_reported_as_they_come_and_the_final_output_equals_that_of_infer(cell, tmp_path):
    cell.at(1.0, cell.write, "b")
    cell.at(2.0, cell.write, "a")
    cell.at(3.0, cell.write, "c")
    report = cell.follow()
    assert cell.names_reported() == [("b", "ok"), ("a", "ok"), ("c", "empty")]
    assert (report.done, report.exit_code) == (["b", "a", "c"], 0)
    for frame in cell.reported:
        assert 0.3 <= frame.seconds <= 0.5  # the wait for frames to be whole; work takes no time
        assert grasps_file.read_part(Path(frame.text)).name == frame.name
    cell.infer(tmp_path / "plain.h5")
    assert cell.output.read_bytes() == (tmp_path / "plain.h5").read_bytes()


def test_a_signal_does_not_wait_long_for_the_output_and_infer_completes_it(
    cell, tmp_path, monkeypatch, caplog
):
    monkeypatch.setattr(following, "LONGEST_END", -1.0)
    cell.at(1.0, cell.write, "a")
    cell.at(1.5, signal.raise_signal, signal.SIGTERM)
    report = cell.follow()
    assert (report.done, report.exit_code) == (["a"], 0)
    assert "g.h5 does not hold all frames" in caplog.text
    assert not cell.output.exists()
    assert cell.infer(cell.output).skipped == ["a"]
    cell.infer(tmp_path / "plain.h5")
    assert cell.output.read_bytes() == (tmp_path / "plain.h5").read_bytes()


def test_all_frames_are_worked_on_in_the_same_few_threads(cell, monkeypatch):
    used, work = set(), following.infer_frame

    def noted(item, settings):
        used.add(threading.current_thread())
        return work(item, settings)

    monkeypatch.setattr(following, "infer_frame", noted)
    for count, time in enumerate([1.0, 1.0, 2.0, 3.0, 4.0, 4.0, 5.0, 5.0]):
        cell.at(time, partial(cell.write, as_name=f"c{count}"), "c")
    assert len(cell.follow().done) == 8
    assert threading.main_thread() not in used
    assert len(used) <= min(cpu_count(), MAX_THREADS)


def test_infer_without_watch_finds_the_output_finished_and_removes_its_parts(cell):
    cell.write("a")
    cell.follow()
    assert grasps_file.parts_folder(cell.output).exists()
    assert cell.infer(cell.output).skipped == ["a"]
    assert not grasps_file.parts_folder(cell.output).exists()


def test_infer_without_watch_goes_on_where_the_output_lacks_later_frames(cell, tmp_path):
    cell.write("a")
    cell.follow()
    cell.write("b")
    report = cell.infer(cell.output)
    assert (report.skipped, report.done) == (["a"], ["b"])
    cell.infer(tmp_path / "plain.h5")
    assert cell.output.read_bytes() == (tmp_path / "plain.h5").read_bytes()
    cell.write("c")
    with pytest.raises(StaleOutputError):  # the output has no parts any more
        cell.infer(cell.output)


def test_a_half_written_pair_is_not_read_yet(cell):
    cell.write("a", files=("camera.json", "color.png"))
    cell.at(1.0, cell.write_half, "a")
    cell.at(4.0, cell.write, "a")
    report = cell.follow()
    assert cell.names_reported() == [("a", "ok")]
    assert report.exit_code == 0
    assert cell.reported[0].seconds <= 0.5


def test_a_frame_that_stays_bad_is_named_and_does_not_stop_the_others(cell):
    cell.write("b")
    cell.write_half("b")
    cell.at(1.0, cell.write, "a")
    cell.at(20.0, cell.write, "c")
    report = cell.follow()
    assert cell.names_reported() == [("a", "ok"), ("b", "failed"), ("c", "empty")]
    assert "b_depth.png" in cell.reported[1].text
    assert 5.0 <= cell.reported[1].seconds < 6.0
    assert (list(report.failed), report.exit_code) == (["b"], 1)
    assert cell.statuses() == {"a": "ok", "b": "failed", "c": "empty"}


def test_a_bad_frame_is_named_at_the_end_too(cell):
    cell.write("b")
    cell.write_half("b")
    assert list(cell.follow(timeout=1.0).failed) == ["b"]
    assert cell.statuses() == {"b": "failed"}


def test_a_bad_frame_is_done_once_it_is_whole(cell):
    cell.write("b")
    cell.write_half("b")
    cell.at(10.0, cell.write, "b")
    report = cell.follow()
    assert cell.names_reported() == [("b", "failed"), ("b", "ok")]
    assert report.exit_code == 0
    assert cell.statuses() == {"b": "ok"}


def test_the_watch_ends_at_the_timeout_after_the_last_frame_and_no_sooner(cell):
    cell.at(2.0, cell.write, "a")
    cell.at(6.5, cell.write, "b")
    cell.at(13.0, cell.write, "c")
    report = cell.follow(timeout=5.0)
    assert report.done == ["a", "b"]
    assert 11.8 <= cell.time <= 12.3  # the last frame is read once it has settled, at 6.8


def test_a_frame_written_again_is_done_again(cell):
    cell.write("a")
    cell.at(5.0, lambda: cell.write("c", as_name="a"))
    cell.follow()
    assert cell.names_reported() == [("a", "ok"), ("a", "empty")]
    assert cell.statuses() == {"a": "empty"}


def test_outputs_read_during_the_watch_are_whole_and_grow(cell):
    seen = []
    for time in (1.0, 5.0, 9.0):
        cell.at(time, lambda: seen.append(cell.statuses() if cell.output.exists() else None))
    cell.at(2.0, cell.write, "a")
    cell.at(6.0, cell.write, "b")
    cell.follow()
    assert seen == [None, {"a": "ok"}, {"a": "ok", "b": "ok"}]


class OnDemand(Executor):
    """Begins a task only when its result is awaited, as a busy thread does."""

    def submit(self, task, /, *arguments, **options):
        class Late(Future):
            def result(self, timeout=None):
                return task(*arguments, **options)

        return Late()


def test_frames_do_not_wait_for_the_output_unless_they_are_in_it(cell):
    cell.writer = OnDemand()
    seen = []
    cell.write("a")
    cell.at(5.0, cell.write, "b")
    cell.at(8.0, lambda: seen.append(cell.output.exists()))
    cell.at(9.0, lambda: cell.write("c", as_name="a"))
    cell.at(12.0, lambda: seen.append(cell.statuses()))
    cell.follow()
    assert seen == [False, {"a": "ok"}]  # begun before b came, ended before a is written again
    assert cell.names_reported()[:2] == [("a", "ok"), ("b", "ok")]
    assert cell.statuses() == {"a": "empty", "b": "ok"}


class Slow(Executor):
    """Takes 2 seconds of the cell's time for each task."""

    def __init__(self, cell):
        self.cell, self.begun = cell, []

    def submit(self, task, /, *arguments, **options):
        cell, due = self.cell, self.cell.time + 2.0
        self.begun.append(cell.time)

        class Later(Future):
            def done(self):
                return cell.time >= due

            def result(self, timeout=None):
                cell.time = max(cell.time, due)
                return task(*arguments, **options)

        return Later()


def test_putting_a_slow_output_together_takes_a_tenth_of_the_time(cell):
    cell.writer = Slow(cell)
    for count in range(12):
        cell.at(1.0 + 4.0 * count, lambda name=f"a{count}": cell.write("c", as_name=name))
    cell.follow(timeout=60.0)
    pauses = [after - before for before, after in pairwise(cell.writer.begun)]
    assert len(pauses) >= 2
    assert min(pauses) >= 20.0
    assert cell.statuses().keys() == {f"a{count}" for count in range(12)}


def test_an_output_that_cannot_be_written_raises_an_error(cell, monkeypatch):
    def full(*arguments):
        raise OSError("no space left on device")

    monkeypatch.setattr(infer_watch.InferRun, "assemble", full)
    cell.writer = None
    cell.write("a")
    with pytest.raises(OSError, match="no space left"):
        cell.follow()


def test_a_frame_that_cannot_be_written_ends_the_watch_and_a_later_run_goes_on(cell, monkeypatch):
    def full(*arguments):
        raise OSError(errno.ENOSPC, "no space left on device")

    cell.write("a")
    cell.follow(timeout=5.0)
    cell.write("b")
    with monkeypatch.context() as patch:
        patch.setattr(grasps_file, "write", full)
        with pytest.raises(WriteError, match="no space left"):
            cell.follow()
    cell.follow()
    assert cell.statuses() == {"a": "ok", "b": "ok"}


def test_a_file_of_another_program_is_not_overwritten(cell):
    cell.output.write_bytes(b"a picture")
    with pytest.raises(SymgraspError, match=r"is no grasps\.h5"):
        cell.follow(options=dataclasses.replace(OPTIONS, overwrite=True))
    assert cell.output.read_bytes() == b"a picture"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_watch_with_all_frames_so_far(cell, number):
    before = signal.getsignal(number)
    cell.write("a")
    cell.at(1.0, signal.raise_signal, number)
    cell.at(2.0, cell.write, "b")
    report = cell.follow(timeout=math.inf)
    assert (report.done, report.exit_code) == (["a"], 0)
    assert cell.statuses() == {"a": "ok"}
    assert signal.getsignal(number) == before


def test_the_watch_goes_on_from_the_results_of_an_earlier_run(cell, tmp_path):
    cell.write("b")
    cell.follow()
    cell.at(cell.time + 1.0, cell.write, "a")
    report = cell.follow()
    assert (report.skipped, report.done) == (["b"], ["a"])
    assert cell.names_reported() == [("b", "ok"), ("a", "ok")]
    cell.infer(tmp_path / "plain.h5")
    assert cell.output.read_bytes() == (tmp_path / "plain.h5").read_bytes()


def test_frames_that_the_camera_removes_are_kept_after_a_restart_too(cell):
    cell.write("b")
    cell.at(3.0, cell.remove, "b")
    cell.at(4.0, cell.write, "a")
    cell.follow()
    assert list(cell.statuses()) == ["b", "a"]
    cell.at(cell.time + 1.0, cell.write, "c")
    cell.follow()
    assert list(cell.statuses()) == ["b", "a", "c"]


def test_an_output_of_other_settings_is_refused_unless_overwritten(cell):
    cell.write("a")
    cell.follow()
    other = dataclasses.replace(CONFIG, gripper="franka")
    with pytest.raises(StaleOutputError):
        cell.follow(config=other)
    cell.remove("a")
    cell.write("b")
    cell.follow(config=other, options=dataclasses.replace(OPTIONS, overwrite=True))
    assert cell.statuses() == {"b": "ok"}


def test_overwriting_names_the_frames_that_nothing_can_make_again(cell, caplog):
    overwriting = dataclasses.replace(OPTIONS, overwrite=True)
    for again in (
        cell.follow,
        partial(infer.run, infer.InferPaths(cell.frames, cell.output), CONFIG),
    ):
        cell.write("a")
        cell.write("b")
        cell.follow()
        cell.output.unlink()  # as after a kill
        cell.remove("a")
        caplog.clear()
        again(options=overwriting)
        (line,) = [
            each.getMessage() for each in caplog.records if "--overwrite" in each.getMessage()
        ]
        assert f"of 1 frame not among those of {cell.frames} now" in line
        assert line.endswith("for example a")
        assert cell.statuses() == {"b": "ok"}


def test_the_names_of_removed_parts_are_those_of_their_frames(cell, caplog):
    (cell.frames / "left").mkdir()
    cell.write("a", as_name="left/a")
    cell.write("b", as_name="left/b")
    cell.follow()
    cell.output.unlink()  # as after a kill
    infer.run(
        infer.InferPaths(cell.frames, cell.output),
        CONFIG,
        dataclasses.replace(OPTIONS, overwrite=True),
        choice=ChosenFrames(stride=2),
    )
    assert "for example left/b" in caplog.text


def test_results_of_removed_frames_are_not_overwritten(cell):
    cell.write("a")
    cell.infer(cell.output)
    cell.remove("a")
    with pytest.raises(SymgraspError, match="for example a;"):
        cell.follow()
    assert cell.statuses() == {"a": "ok"}


def test_without_a_frame_nothing_is_written(cell):
    report = cell.follow()
    assert (report.done, report.exit_code) == ([], 0)
    assert not cell.output.exists()


def test_options_that_a_watch_cannot_take_give_one_sentence_each(cell, tmp_path):
    with pytest.raises(SymgraspError, match="--masks"):
        cell.follow(masks=tmp_path)
    for options in ({"workers": 2}, {"backend": "dask"}, {"dry_run": True}):
        with pytest.raises(SymgraspError, match="leave out --workers"):
            cell.follow(options=dataclasses.replace(OPTIONS, **options))
    cell.frames.rmdir()
    with pytest.raises(SymgraspError, match="is no folder"):
        cell.follow()


def test_the_watch_waits_for_a_folder_that_disappears_for_a_moment(cell, caplog):
    away = cell.frames.with_name("away")
    cell.write("a")
    cell.at(1.0, cell.frames.rename, away)
    cell.at(3.0, away.rename, cell.frames)
    cell.at(4.0, cell.write, "b")
    cell.at(6.0, cell.frames.rename, away)
    cell.at(7.0, away.rename, cell.frames)
    assert cell.follow().done == ["a", "b"]
    assert caplog.text.count("cannot look for frames") == 2  # once each time


def test_a_frame_counts_once_whether_it_comes_back_changes_or_turns_bad(cell):
    away = cell.frames.with_name("away")
    cell.write("a")
    cell.write("b")
    cell.at(3.0, cell.frames.rename, away)  # as a share that is not mounted: an empty folder
    cell.at(3.0, cell.frames.mkdir)
    cell.at(5.0, cell.frames.rmdir)
    cell.at(5.0, away.rename, cell.frames)
    report = cell.follow()
    assert (report.done, report.skipped) == (["a", "b"], [])
    cell.at(cell.time + 3.0, lambda: cell.write("c", as_name="a"))
    cell.at(cell.time + 3.0, cell.write_half, "b")
    report = cell.follow()
    assert (report.done, report.skipped, list(report.failed)) == (["a"], [], ["b"])


def test_a_time_out_without_watch_is_wrong_usage(tmp_path):
    arguments = ["infer", str(tmp_path), "--watch-timeout", "5"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2
    assert "--watch" in result.output


@contextmanager
def started(cell):
    """Start the command on the folder of `cell`."""
    code = "from symgrasp_cli.main import main; main()"
    options = ["--watch", "--watch-timeout", "300", "--regions", "geometric", "--method", "planar"]
    command = [sys.executable, "-c", code, "infer", str(cell.frames), "--out", str(cell.output)]
    with subprocess.Popen(
        [*command, *options],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        yield process


def test_a_reader_that_goes_away_ends_the_watch_in_one_sentence(cell):
    with started(cell) as process:
        assert process.stderr.readline() == f"watching {cell.frames} until Ctrl-C\n"
        process.stdout.close()
        cell.write("c")
        said = process.stderr.read().splitlines()
    assert said[-1] == "error: the reader of stdout has gone; the same command continues from here"
    assert process.returncode == 1
    assert grasps_file.part_path(cell.output, "c").exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_command_prints_a_line_a_frame_and_heeds_signals(cell, number):
    cell.write("a")
    with started(cell) as process:
        assert process.stderr.readline() == f"watching {cell.frames} until Ctrl-C\n"
        first = process.stdout.readline().split("  ")
        cell.write("b")
        second = process.stdout.readline().split("  ")
        process.send_signal(number)
        rest = process.stdout.read()
    assert (first[:2], second[:2]) == (["a", "ok"], ["b", "ok"])
    assert first[4].strip() == str(grasps_file.part_path(cell.output, "a"))
    assert (process.returncode, rest) == (0, "")
    assert cell.statuses() == {"a": "ok", "b": "ok"}


def grasps_of(cell, name):
    results = {result.name: result for result in read_whole(cell.output).results}
    return len(results[name].grasps)


def test_a_frame_that_is_removed_file_by_file_keeps_its_grasps(cell):
    cell.write("b")
    cell.at(3.0, (cell.frames / "b_depth.png").unlink)
    cell.at(5.0, cell.remove, "b")
    cell.at(6.0, cell.write, "a")
    report = cell.follow()
    assert cell.names_reported() == [("b", "ok"), ("a", "ok")]
    assert (report.failed, cell.statuses()) == ({}, {"b": "ok", "a": "ok"})
    assert grasps_of(cell, "b") > 0
    cell.at(cell.time + 1.0, cell.write, "c")
    cell.follow()
    assert list(cell.statuses()) == ["b", "a", "c"]


def test_a_frame_that_is_replaced_slowly_keeps_its_old_grasps_until_the_new_are_found(cell):
    seen = []
    cell.write("b")
    cell.at(4.0, cell.write_half, "b")
    cell.at(5.0, cell.write, "a")
    cell.at(8.2, lambda: seen.append((cell.statuses(), grasps_of(cell, "b"))))
    cell.at(8.6, lambda: cell.write("c", as_name="b"))
    report = cell.follow()
    ((statuses, before),) = seen
    assert statuses == {"a": "ok", "b": "ok"}
    assert before > 0
    assert cell.names_reported() == [("b", "ok"), ("a", "ok"), ("b", "empty")]
    assert (report.exit_code, cell.statuses()) == (0, {"a": "ok", "b": "empty"})


def test_a_finished_frame_that_turns_bad_has_failed_and_has_no_part(cell):
    cell.write("b")
    cell.at(4.0, cell.write_half, "b")
    report = cell.follow()
    assert cell.names_reported() == [("b", "ok"), ("b", "failed")]
    assert (list(report.failed), cell.statuses()) == (["b"], {"b": "failed"})
    assert not grasps_file.part_path(cell.output, "b").exists()


def test_grasps_of_a_frame_that_is_bad_at_the_end_are_not_lost_for_good(cell):
    cell.write("b")
    cell.at(4.0, cell.write_half, "b")
    cell.at(5.0, signal.raise_signal, signal.SIGTERM)
    assert list(cell.follow().failed) == ["b"]
    cell.remove("b")
    cell.write("a")
    cell.follow()
    assert cell.statuses() == {"b": "ok", "a": "ok"}


def test_a_removed_part_is_left_out_with_a_warning(cell, caplog):
    cell.write("a")
    cell.at(4.0, grasps_file.part_path(cell.output, "a").unlink)
    cell.at(5.0, cell.write, "b")
    assert cell.follow().done == ["a", "b"]
    assert cell.statuses() == {"b": "ok"}
    assert "a: its part is missing" in caplog.text


def test_pictures_that_an_earlier_run_did_not_draw_are_drawn(cell, tmp_path):
    cell.write("a")
    cell.follow()
    cell.at(cell.time + 1.0, cell.write, "b")
    cell.follow(overlays=tmp_path / "pictures")
    cell.output.unlink()
    paths = infer.InferPaths(cell.frames, cell.output, tmp_path / "whole")
    infer.run(paths, CONFIG, OPTIONS)
    for name in ("a", "b"):
        drawn = (tmp_path / "pictures" / f"{name}.png").read_bytes()
        assert drawn == (tmp_path / "whole" / f"{name}.png").read_bytes()
