"""Detection of whole frames in a watched folder, with numbers in the place of a clock."""

import os

import pytest

from pipelines.configs import WatchConfig
from pipelines.frames.rgbd import FrameSource
from pipelines.inference.runs.watching import Lister, Watcher

CONFIG = WatchConfig(settle=1.0, patience=5.0, relist=2.0)


@pytest.fixture
def watcher():
    return Watcher(CONFIG)


def source(folder, name="a", text="x"):
    path = folder / name
    path.write_text(text)
    return FrameSource(name, lambda: None, (path,))


def names(arrivals):
    return [arrival.source.name for arrival in arrivals]


def test_a_frame_is_whole_once_it_has_not_changed_for_a_while(watcher, tmp_path):
    frame = source(tmp_path)
    assert watcher.arrivals([frame], 10.0) == []
    assert watcher.arrivals([frame], 10.9) == []
    assert names(watcher.arrivals([frame], 11.0)) == ["a"]


def test_a_growing_frame_is_not_whole_yet(watcher, tmp_path):
    for time in range(10):
        assert watcher.arrivals([source(tmp_path, text="x" * (time + 1))], 0.9 * time) == []
    assert watcher.is_waiting()
    assert names(watcher.arrivals([source(tmp_path, text="x" * 10)], 20.0)) == []  # written anew
    again = FrameSource("a", lambda: None, (tmp_path / "a",))
    assert names(watcher.arrivals([again], 21.0)) == ["a"]


def test_a_second_file_counts_as_a_change(watcher, tmp_path):
    color = source(tmp_path)
    watcher.arrivals([color], 0.0)
    both = FrameSource("a", lambda: None, (*color.files, *source(tmp_path, "b").files))
    assert watcher.arrivals([both], 1.0) == []
    assert names(watcher.arrivals([both], 2.0)) == ["a"]


def test_a_finished_frame_is_returned_again_only_if_it_changes(watcher, tmp_path):
    frame = source(tmp_path)
    watcher.arrivals([frame], 0.0)
    watcher.finish("a")
    assert watcher.arrivals([frame], 100.0) == []
    assert not watcher.is_waiting()
    source(tmp_path, text="longer")
    assert watcher.arrivals([frame], 101.0) == []
    assert names(watcher.arrivals([frame], 102.0)) == ["a"]


def test_a_postponed_frame_gets_one_last_try(watcher, tmp_path):
    frame = source(tmp_path)
    watcher.arrivals([frame], 0.0)
    (first,) = watcher.arrivals([frame], 1.0)
    assert not first.is_last_try
    watcher.put_off("a")
    assert watcher.arrivals([frame], 4.9) == []
    (last,) = watcher.arrivals([frame], 5.0)
    assert last.is_last_try
    assert last.since == 0.0


def test_a_postponed_frame_is_returned_soon_if_it_changes(watcher, tmp_path):
    frame = source(tmp_path)
    watcher.arrivals([frame], 0.0)
    watcher.put_off("a")
    source(tmp_path, text="whole")
    watcher.arrivals([frame], 2.0)
    (arrival,) = watcher.arrivals([frame], 3.0)
    assert not arrival.is_last_try


def test_the_frame_unchanged_for_longest_comes_first(watcher, tmp_path):
    late, early = source(tmp_path, "a"), source(tmp_path, "z")
    watcher.arrivals([early], 0.0)
    watcher.arrivals([late, early], 0.5)
    assert names(watcher.arrivals([late, early], 9.0)) == ["z", "a"]
    assert watcher.last_change() == 0.5


def test_a_frame_whose_file_disappears_is_dropped(watcher, tmp_path):
    frame = source(tmp_path)
    watcher.arrivals([frame], 0.0)
    frame.files[0].unlink()
    assert watcher.arrivals([frame], 9.0) == []
    watcher.finish("a")
    assert not watcher.is_waiting()
    assert watcher.last_change() is None


class Folder:
    """A folder that counts its listings and sets times of change, as file clocks are coarse."""

    def __init__(self, folder):
        self.folder, self.listings = folder, 0
        self.lister = Lister(self.find, folder, CONFIG)

    def find(self):
        self.listings += 1
        files = sorted(path for path in self.folder.rglob("*") if path.is_file())
        return [FrameSource(path.name, lambda: None, (path,)) for path in files]

    def write(self, path, changed_at):
        path = self.folder / path
        path.parent.mkdir(exist_ok=True)
        path.write_text("x")
        os.utime(path.parent, (changed_at, changed_at))

    def names(self, now):
        return [source.name for source in self.lister.frames(now)]


def test_a_folder_is_listed_again_only_if_it_changes_or_after_a_while(tmp_path):
    folder = Folder(tmp_path)
    folder.write("a", 100)
    for now in (0.0, 0.5, 1.9):
        assert folder.names(now) == ["a"]
    assert folder.listings == 1
    folder.write("b", 200)
    assert folder.names(1.95) == ["a", "b"]
    assert folder.listings == 2
    folder.write("c", 200)  # within one tick of the file system's clock
    assert folder.names(3.9) == ["a", "b"]
    assert folder.names(4.0) == ["a", "b", "c"]


def test_subfolders_are_watched_too(tmp_path):
    folder = Folder(tmp_path)
    folder.write("one/a", 100)
    os.utime(tmp_path, (100, 100))
    assert folder.names(0.0) == ["a"]
    assert folder.names(0.1) == ["a"]  # once more, as `one` is new
    folder.write("one/b", 200)
    assert folder.names(0.2) == ["a", "b"]
    assert folder.listings == 3


def test_a_change_during_a_listing_is_seen_by_the_next_one(tmp_path):
    folder = Folder(tmp_path)
    folder.write("a", 100)
    find = folder.find

    def interrupted():
        found = find()
        if folder.listings == 1:
            folder.write("b", 200)
        return found

    folder.lister = Lister(interrupted, tmp_path, CONFIG)
    assert folder.names(0.0) == ["a"]
    assert folder.names(0.1) == ["a", "b"]
