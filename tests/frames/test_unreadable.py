"""Files and folders that a user may not read: others next to them are read."""

import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pipelines.errors import SymgraspError, error_sentence
from pipelines.frames.frames import find_frames

Forbid, Save = Callable[[Path], None], Callable[..., None]
NAMES = ("color.png", "depth.png", "camera.json")


@pytest.fixture
def forbid(monkeypatch: pytest.MonkeyPatch) -> Forbid:
    """Return a function after which this user may not read a file or folder; root may read all."""
    forbidden: set[Path] = set()
    opened, listed, accessed = Path.open, os.listdir, os.access

    def refuse(path: Path) -> None:
        if path in forbidden:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    def open_(path: Path, *arguments: Any, **options: Any) -> Any:
        refuse(path)
        return opened(path, *arguments, **options)

    def list_(path: Path) -> list[str]:
        refuse(path)
        return listed(path)

    monkeypatch.setattr(Path, "open", open_)
    monkeypatch.setattr(os, "listdir", list_)
    monkeypatch.setattr(
        os, "access", lambda path, mode: path not in forbidden and accessed(path, mode)
    )
    return forbidden.add


@pytest.mark.parametrize("name", ["camera.json", "calib.json", "calib.txt", "info.yml"])
def test_a_file_that_is_not_of_the_frames_does_no_harm(
    flat: Path, forbid: Forbid, name: str
) -> None:
    count = len(find_frames(flat))
    (flat / name).write_bytes(b"{}")
    forbid(flat / name)
    assert len([source.read() for source in find_frames(flat)]) == count


def test_a_folder_that_may_not_be_read_hides_no_others(
    tmp_path: Path, save: Save, forbid: Forbid, caplog: pytest.LogCaptureFixture
) -> None:
    save(*(tmp_path / "frames" / name for name in NAMES))
    (tmp_path / "lost+found").mkdir()
    forbid(tmp_path / "lost+found")
    assert [source.read() for source in find_frames(tmp_path)]
    assert "lost+found is not searched" in caplog.text


@pytest.mark.parametrize("name", ["transforms.json", "x.mcap"])
def test_a_file_that_may_not_be_read_fails_its_folder_alone(
    tmp_path: Path, save: Save, forbid: Forbid, name: str
) -> None:
    save(*(tmp_path / "frames" / each for each in NAMES))
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / name).write_bytes(b"")
    forbid(tmp_path / "other" / name)
    first, last = find_frames(tmp_path)
    assert first.read().depth.any()
    with pytest.raises(PermissionError) as caught:
        last.read()
    assert f"{name} cannot be read or written (Permission denied)" in error_sentence(caught.value)


def test_the_folder_given_is_named_if_it_may_not_be_read(flat: Path, forbid: Forbid) -> None:
    forbid(flat)
    with pytest.raises(PermissionError) as caught:
        find_frames(flat)
    assert error_sentence(caught.value).startswith(f"{flat} cannot be read")


def test_a_file_in_a_folder_with_a_damaged_index_is_refused_by_its_fault(flat: Path) -> None:
    (flat / "transforms.json").write_text("{")
    image = find_frames(flat)[0]
    (source,) = find_frames(next(flat.glob("*.png")))
    for each in (image, source):
        with pytest.raises(SymgraspError, match=r"transforms\.json: this is not JSON"):
            each.read()
