"""Progress without a terminal: lines on stderr while a batch runs, and their content."""

import io
import sys
import threading
import time

import pytest

from pipelines.errors import WriteError
from pipelines.runtime import progress
from pipelines.runtime.batch import BatchOptions, WorkItem, run_batch
from pipelines.runtime.progress import duration, progress_line, with_progress
from pipelines.storage.provenance import make_stamp


@pytest.mark.parametrize(
    ("seconds", "text"), [(-3, "0:00"), (59.6, "1:00"), (3599, "59:59"), (7322, "2:02:02")]
)
def test_durations_are_written_in_short_form(seconds, text):
    assert duration(seconds) == text


def test_a_line_states_the_finished_items_and_the_time_left():
    assert progress_line("infer", 30, 120, 60.0) == "infer: 30 of 120 done, 3:00 left"
    assert progress_line("infer", 0, 120, 60.0) == "infer: 0 of 120 done"


def test_lines_come_while_one_item_takes_long(monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(progress, "LINE_SECONDS", 0.001)

    def slow():
        yield "a"
        while "1 of 2 done" not in stream.getvalue():  # the item ends when the line has come
            time.sleep(0.001)
        yield "b"

    assert list(with_progress(slow(), "toy", 2)) == ["a", "b"]
    assert stream.getvalue().splitlines()[0].startswith("toy: ")
    assert all(text.startswith("toy: ") for text in stream.getvalue().splitlines())


def test_a_batch_prints_lines_unless_it_is_quiet(tmp_path, monkeypatch):
    monkeypatch.setattr(progress, "LINE_SECONDS", 0.001)
    items = [WorkItem(name, tmp_path / name, make_stamp("toy", {})) for name in "ab"]

    def step(_item):
        time.sleep(0.02)

    for is_shown in (True, False):
        stream = io.StringIO()
        monkeypatch.setattr(sys, "stderr", stream)
        run_batch("toy", items, step, BatchOptions(progress=is_shown))
        assert bool(stream.getvalue()) == is_shown


def test_threads_of_an_interrupted_batch_end_their_items_before_it_ends(tmp_path):
    begun, ended = threading.Event(), threading.Event()

    def step(item):
        if item.name == "a":
            begun.wait()
            raise WriteError(item.target, "no room")
        begun.set()
        time.sleep(0.1)
        ended.set()

    items = [WorkItem(name, tmp_path / name, make_stamp("toy", {})) for name in "ab"]
    options = BatchOptions(workers=2, backend="threading", progress=False)
    with pytest.raises(WriteError):
        run_batch("toy", items, step, options)
    assert ended.is_set()
