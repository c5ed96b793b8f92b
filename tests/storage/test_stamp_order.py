"""A run killed between an output and its stamp leaves no output with a wrong stamp."""

from pathlib import Path

import numpy as np
import pytest

from pipelines.errors import SymgraspError, ValueRangeError
from pipelines.grasp_files import grasp_rows
from pipelines.grasp_files.grasp_rows import VERDICT_ARRAYS, write_verdicts
from pipelines.learning.loop.runs import RunRequest, find_progress
from pipelines.storage.array_files import read_npz
from pipelines.storage.provenance import (
    is_finished,
    make_stamp,
    read_stamp,
    refuse_other_suffix,
    stamp_ahead,
)

OLD, NEW = make_stamp("stage", {"points": 8}), make_stamp("stage", {"points": 64})
ARRAYS = {name: np.zeros(2) for name in VERDICT_ARRAYS}


def test_an_earlier_output_is_removed_before_the_next_stamp_is_written(tmp_path: Path) -> None:
    target = tmp_path / "new" / "a.npz"
    stamp_ahead(target, OLD)
    target.write_bytes(b"old")
    assert is_finished(target, OLD)
    stamp_ahead(target, NEW)
    assert not is_finished(target, NEW)
    assert not is_finished(target, OLD)
    target.write_bytes(b"new")
    assert read_stamp(target) == NEW.as_json()


@pytest.mark.parametrize("function", ["stamp_ahead", "write_npz"])
def test_verdicts_of_a_killed_run_are_made_again(
    function: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def then_killed(*arguments: object, **named: object) -> None:
        write(*arguments, **named)
        raise KeyboardInterrupt

    path, write = tmp_path / "verdicts.npz", getattr(grasp_rows, function)
    monkeypatch.setattr(grasp_rows, function, then_killed)
    with pytest.raises(KeyboardInterrupt):
        write_verdicts(path, ARRAYS, OLD)
    monkeypatch.undo()
    assert is_finished(path, OLD) == (function == "write_npz")  # neither refused nor incomplete
    write_verdicts(path, ARRAYS, OLD)
    assert is_finished(path, OLD)
    assert set(read_npz(path)) == set(VERDICT_ARRAYS)


def test_an_output_suffix_for_which_no_stamp_would_be_found_is_wrong_usage() -> None:
    refuse_other_suffix(Path("folder.txt/a.json"), ".json")
    for name in ("a", "a.txt", "a.JSON", "json"):
        with pytest.raises(ValueRangeError, match=r"--out is .*ends in \.json") as refused:
            refuse_other_suffix(Path(name), ".json")
        assert refused.value.exit_code == 2


def test_a_folder_in_place_of_an_output_file_is_refused_before_the_work(tmp_path: Path) -> None:
    for name in ("a.json", "a.safetensors"):
        (tmp_path / name).mkdir()
    with pytest.raises(SymgraspError, match=r"a.json is a folder; name a file"):
        refuse_other_suffix(tmp_path / "a.json", ".json")
    request = RunRequest(overwrite=True)  # which must not train until there are weights
    with pytest.raises(SymgraspError, match=r"a.safetensors is a folder; name a file"):
        find_progress(tmp_path / "a.safetensors", OLD, request)
