"""Writing of whole files or none, and reading of files."""

import contextlib
import errno
import json
import os
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipelines.configs.toml_files import read_toml
from pipelines.errors import FormatError, SymgraspError, WriteError
from pipelines.frames.encodings.camera_texts import read_camera_text
from pipelines.frames.encodings.yaml_files import read_yaml
from pipelines.storage import array_files, files, images
from pipelines.storage.files import atomic_folder, file_behind, read_json, real_path, within
from pipelines.storage.h5_files import open_h5
from tests.storage.full_disk import little_space

NOISE = np.random.default_rng(0).integers(0, 255, (60, 60, 3), np.uint8)


@pytest.mark.parametrize("name", ["n" * 251 + ".txt", "漢" * 83 + ".txt", os.fsdecode(b"\xe9.txt")])
def test_a_file_of_any_valid_name_can_be_written(name, tmp_path):
    files.write_text(tmp_path / name, "all")
    assert [path.name for path in tmp_path.iterdir()] == [name]
    with files.atomic_folder(tmp_path / f"{name[:-4]}.dir"):
        pass
    assert (tmp_path / f"{name[:-4]}.dir").is_dir()


def test_a_failed_write_leaves_only_the_old_file(tmp_path):
    path = tmp_path / "a.txt"
    files.write_text(path, "old")

    def fail():
        with files.atomic_path(path) as temporary:
            temporary.write_text("half")
            raise RuntimeError("power cut")

    with pytest.raises(RuntimeError, match="power cut"):
        fail()
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_json_round_trips_and_bad_json_is_named(tmp_path):
    path = tmp_path / "a.json"
    files.write_json(path, {"a": [1, 2.5, None]})
    assert files.read_json(path) == {"a": [1, 2.5, None]}
    path.write_text(json.dumps({"a": 1})[:-1])
    with pytest.raises(FormatError, match=r"a\.json.*not JSON"):
        files.read_json(path)


def test_a_missing_file_is_reported_in_one_sentence(tmp_path):
    with pytest.raises(SymgraspError, match="does not exist"):
        files.existing(tmp_path / "none.npy")


@pytest.mark.parametrize(
    "read",
    [read_json, images.read_image, array_files.read_npy, array_files.read_npz, open_h5, read_yaml],
)
def test_a_file_that_git_has_not_downloaded_is_named_so(tmp_path, read):
    (tmp_path / "a").write_text("version https://git-lfs/v1\noid sha256:0\nsize 9\n")
    with pytest.raises(SymgraspError, match=r"a is a pointer of Git LFS; .* `git lfs pull`"):
        read(tmp_path / "a")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize(
    ("read", "text"),
    [
        (read_json, '{"fx": 600.0}'),
        (read_yaml, "fx: 600.0\r\n"),
        (read_toml, "fx = 600.0\r\n"),
        (read_camera_text, "fx=600.0\r\n"),
    ],
)
def test_texts_of_programs_on_windows_are_read(tmp_path, encoding, read, text):
    """PowerShell's > and Notepad write byte order marks, PowerShell also two bytes a letter."""
    (tmp_path / "a").write_bytes(text.encode(encoding))
    assert read(tmp_path / "a") == {"fx": 600.0}


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_images_round_trip(tmp_path, dtype):
    grey = np.random.default_rng(0).integers(0, 250, (7, 9)).astype(dtype)
    images.write_image(tmp_path / "a.png", grey)
    np.testing.assert_array_equal(images.read_image(tmp_path / "a.png"), grey)


def test_colour_is_rgb_on_both_sides(tmp_path):
    red = np.zeros((4, 4, 3), np.uint8)
    red[..., 0] = 255
    images.write_image(tmp_path / "a.png", red)
    np.testing.assert_array_equal(images.read_image(tmp_path / "a.png"), red)


def test_a_truncated_png_is_refused(tmp_path):
    path = tmp_path / "a.png"
    images.write_image(path, np.random.default_rng(0).integers(0, 255, (50, 50)).astype(np.uint8))
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(FormatError, match="cut off"):
        images.read_image(path)
    path.write_bytes(b"hello")
    with pytest.raises(FormatError, match="not a whole image"):
        images.read_image(path)
    path.write_bytes(b"")
    with pytest.raises(FormatError, match="not a whole image"):
        images.read_image(path)


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize(
    ("suffix", "dtype"),
    [(".png", np.uint8), (".png", np.uint16), (".tiff", np.float32), (".tiff", np.float64)],
)
def test_images_are_read_with_their_depth_of_bits_red_first_and_without_alpha(
    tmp_path, channels, suffix, dtype
):
    image = np.random.default_rng(0).integers(0, 255, (5, 7, channels)).astype(dtype)
    path = tmp_path / f"a{suffix}"
    assert cv2.imwrite(str(path), image)
    found = images.read_image(path)
    expected = image[:, :, 0] if channels == 1 else image[:, :, 2::-1]
    assert found.dtype == dtype
    assert found.flags.c_contiguous
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("moment", range(3))
def test_a_folder_is_replaced_completely_or_not_at_all(tmp_path, monkeypatch, moment):
    """A kill between any two moves leaves the earlier folder, the new one, or none at all."""
    target = tmp_path / "folder"
    for text in ("first", "earlier"):
        with files.atomic_folder(target) as folder:
            (folder / "a").write_text(text)
            (folder / "b").write_text(text)
    moves = []

    def dying(path, to):
        if len(moves) == moment:
            raise KeyboardInterrupt
        moves.append(to)
        path.rename(to)

    monkeypatch.setattr(files.Path, "replace", dying)
    with contextlib.suppress(KeyboardInterrupt), files.atomic_folder(target) as folder:
        (folder / "a").write_text("new")
        (folder / "b").write_text("new")
    found = {path.read_text() for path in target.glob("*")}
    assert found == [{"earlier"}, set(), {"new"}][moment]
    assert target.is_dir() == bool(found)


@pytest.mark.skipif(sys.platform == "win32", reason="no limit of file sizes")
@pytest.mark.parametrize(
    "write",
    [
        lambda path: files.write_bytes(path, bytes(9000)),
        lambda path: array_files.write_npy(path, np.arange(9000)),
        lambda path: array_files.write_npz(path, x=np.arange(9000), compress=False),
        lambda path: images.write_image(path, NOISE),
    ],
)
def test_a_full_disk_is_reported_with_the_path_and_leaves_nothing(write, tmp_path):
    with (
        little_space(4096),
        pytest.raises(WriteError, match=r"/x.png cannot be written \(File too"),
    ):
        write(tmp_path / "x.png")
    no_space = pytest.raises(WriteError, match=r"/x cannot be written \(File too")
    with little_space(4096), no_space, atomic_folder(tmp_path / "x") as folder:
        write(folder / "y.png")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("reason", [errno.EROFS, errno.EACCES])
def test_a_folder_that_may_not_be_written_is_reported_with_the_path(reason, tmp_path, monkeypatch):
    def refuse(path, _make):
        raise OSError(reason, os.strerror(reason), str(path.with_name(".x.a698b7.json")))

    monkeypatch.setattr(files, "new_temporary", refuse)
    refused = rf"^{tmp_path}/x.json cannot be written \({os.strerror(reason)}"
    for write in (files.write_json, lambda path, _: atomic_folder(path).__enter__()):
        with pytest.raises(WriteError, match=refused):
            write(tmp_path / "x.json", {})


def test_a_link_that_leads_out_of_an_output_folder_is_refused(tmp_path):
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    for folder in (out / "inside", elsewhere):
        folder.mkdir(parents=True)
    (out / "link").symlink_to(elsewhere)
    (out / "own").symlink_to(out / "inside")
    for name in ("a.png", "inside/a.png", "own/a.png", "new/deep/a.png"):
        assert within(out, out / name) == out / name
    for name in ("link/a.png", "link/new/a.png"):
        with pytest.raises(SymgraspError, match="leads out of"):
            within(out, out / name)


def test_a_folder_given_as_a_link_is_replaced_at_its_target(tmp_path):
    (tmp_path / "disk/out").mkdir(parents=True)
    (tmp_path / "out").symlink_to("disk/out")
    with atomic_folder(tmp_path / "out") as folder:
        (folder / "new").touch()
    assert (tmp_path / "disk/out/new").is_file()
    assert (tmp_path / "out").is_symlink()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["disk", "out"]


@pytest.mark.parametrize("name", [".", "..", "../out"])
def test_the_working_folder_is_not_replaced(name, tmp_path, monkeypatch):
    (tmp_path / "out").mkdir()
    (tmp_path / "out/kept").touch()
    monkeypatch.chdir(tmp_path / "out")
    refused = pytest.raises(SymgraspError, match="run the command from another folder")
    with refused, atomic_folder(Path(name)):
        pass
    assert (tmp_path / "out/kept").is_file()
    assert Path("kept").is_file()
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_link_to_a_file_stands_for_the_file_and_a_link_to_a_folder_for_itself(tmp_path):
    (tmp_path / "disk").mkdir()
    for name, target in {"file": "disk/x", "folder": "disk", "circle": "circle"}.items():
        (tmp_path / name).symlink_to(target)
    assert file_behind(tmp_path / "file") == real_path(tmp_path / "disk/x")
    for name in ("folder", "circle", "disk", "nothing"):
        assert file_behind(tmp_path / name) == tmp_path / name


def test_a_pipe_is_refused_as_file(tmp_path):
    os.mkfifo(tmp_path / "x.json")
    with pytest.raises(SymgraspError, match="is no plain file"):
        read_json(tmp_path / "x.json")


def test_a_file_in_place_of_a_folder_is_named(tmp_path):
    (tmp_path / "file").touch()
    for path in (tmp_path / "file" / "x.json", tmp_path / "file" / "a" / "b" / "x.json"):
        with pytest.raises(SymgraspError, match="file is a file; name a folder"):
            files.write_json(path, {})
