"""Stamps: an output is finished if it was made with the settings and inputs of this run."""

import errno
import os
from pathlib import Path

import h5py
import numpy as np
import pytest
from safetensors.numpy import save_file

from pipelines.configs import RefineGraspsConfig
from pipelines.errors import StaleOutputError, SymgraspError, WriteError
from pipelines.pictures.grasp_page.page import index_page
from pipelines.storage.files import write_json
from pipelines.storage.provenance import (
    MISSING,
    digest,
    digest_folder,
    is_finished,
    make_stamp,
    read_stamp,
    refuse_foreign,
    stamp_ahead,
    write_sidecar,
)

STAMP = make_stamp("refine-grasps", RefineGraspsConfig(), seed=3, inputs={"a": "sha256:0"})


def write_h5(path):
    with h5py.File(path, "w") as file:
        file.attrs["provenance"] = STAMP.as_text()


def write_folder(path):
    path.mkdir()
    write_sidecar(path, STAMP)


def write_plain(path):
    path.write_bytes(b"x")
    write_sidecar(path, STAMP)


def write_page(path):
    path.write_text(index_page("frames", [], STAMP))


WRITERS = {
    "a.h5": write_h5,
    "a.html": write_page,
    "a.json": lambda path: write_json(path, {"provenance": STAMP.as_json()}),
    "a.safetensors": lambda path: save_file(
        {"w": np.zeros(1)}, path, {"provenance": STAMP.as_text()}
    ),
    "h5": write_h5,
    "folder": write_folder,
    **{f"folder{suffix}": write_folder for suffix in (".json", ".h5", ".html", ".safetensors")},
    "a.npz": write_plain,
}


@pytest.mark.parametrize("name", WRITERS)
def test_every_kind_of_output_carries_its_stamp(tmp_path, name):
    target = tmp_path / name
    assert not is_finished(target, STAMP)
    WRITERS[name](target)
    assert read_stamp(target) == STAMP.as_json()
    assert is_finished(target, STAMP)
    assert not is_finished(target, STAMP, overwrite=True)


@pytest.mark.parametrize("name", WRITERS)
def test_an_output_of_another_stage_is_not_overwritten(tmp_path, name):
    refuse_foreign(tmp_path / name, STAMP.stage)
    WRITERS[name](tmp_path / name)
    refuse_foreign(tmp_path / name, STAMP.stage)
    with pytest.raises(SymgraspError, match="no output of export; choose another"):
        refuse_foreign(tmp_path / name, "export")


@pytest.mark.parametrize("name", WRITERS)
def test_an_output_made_with_other_settings_is_refused(tmp_path, name):
    target = tmp_path / name
    WRITERS[name](target)
    other = make_stamp("refine-grasps", RefineGraspsConfig(copies_per_turn=8), seed=3)
    with pytest.raises(StaleOutputError, match="--overwrite"):
        is_finished(target, other)


@pytest.mark.parametrize("content", ["", "<html>", '<meta name="provenance" content="[1">', "\xff"])
def test_a_page_of_another_program_has_no_stamp(tmp_path, content):
    (tmp_path / "a.html").write_bytes(content.encode("latin1"))
    assert read_stamp(tmp_path / "a.html") is None


@pytest.mark.parametrize("stamp", ["me", 3, None, ["annotate-symmetry"]])
def test_other_content_at_the_place_of_the_stamp_is_not_read_as_stamp(tmp_path, stamp):
    write_json(tmp_path / "a.json", {"provenance": stamp})
    assert read_stamp(tmp_path / "a.json") is None
    with pytest.raises(StaleOutputError, match="--overwrite"):
        is_finished(tmp_path / "a.json", STAMP)


def test_a_setting_without_a_limit_is_stored_as_valid_json(tmp_path):
    stamp = make_stamp("workspace", {"margin": float("inf"), "low": [float("-inf")]})
    path = tmp_path / "picture.png"
    path.write_bytes(b"x")
    write_sidecar(path, stamp)
    assert read_stamp(path)["config"] == {"margin": "inf", "low": ["-inf"]}
    assert is_finished(path, stamp)
    assert "Infinity" not in stamp.as_text()


def test_the_digest_changes_with_the_content(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"1")
    first = digest(path)
    path.write_bytes(b"2")
    assert digest(path) != first


def test_the_digest_of_a_folder_changes_with_names_and_contents(tmp_path):
    (tmp_path / "a.h5").write_bytes(b"1")
    first = digest_folder(tmp_path, "*.h5")
    (tmp_path / "a.h5").write_bytes(b"2")
    second = digest_folder(tmp_path, "*.h5")
    (tmp_path / "a.h5").rename(tmp_path / "b.h5")
    assert len({first, second, digest_folder(tmp_path, "*.h5")}) == 3


def test_outputs_of_another_version_are_reused_and_reported_once(tmp_path, caplog):
    made = STAMP.as_json()
    write_json(tmp_path / "new.json", {"provenance": made})
    for name in ("a.json", "b.json"):
        write_json(tmp_path / name, {"provenance": made | {"version": "0.0.7"}})
    assert is_finished(tmp_path / "new.json", STAMP)
    assert not caplog.messages
    assert is_finished(tmp_path / "a.json", STAMP)
    assert is_finished(tmp_path / "b.json", STAMP)
    (message,) = caplog.messages
    assert "made by symgrasp 0.0.7" in message
    assert f"installed is {made['version']}" in message


def test_the_digest_of_a_pipe_does_not_wait_for_its_end(tmp_path):
    os.mkfifo(tmp_path / "x.pcd")
    assert digest(tmp_path / "x.pcd") == "no plain file"


@pytest.mark.parametrize("refused", ["unlink", "mkdir"])
def test_a_stamp_in_a_folder_that_may_not_be_written_is_no_fault_of_an_item(
    refused, tmp_path, monkeypatch
):
    def refuse(path, **_options):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))

    monkeypatch.setattr(Path, refused, refuse)
    with pytest.raises(WriteError, match=f"^{tmp_path}/new.* cannot be written"):
        stamp_ahead(tmp_path / "new" / "model.npz", STAMP)


def test_an_output_whose_inputs_are_lost_is_not_to_be_overwritten(tmp_path):
    path = tmp_path / "a.json"
    made = make_stamp("refine-grasps", {}, inputs={"mesh": "sha256:0", "extra": MISSING})
    write_json(path, {"provenance": made.as_json()})
    lost = make_stamp("refine-grasps", {}, inputs={"mesh": MISSING, "extra": MISSING})
    with pytest.raises(StaleOutputError, match=r"any more \(mesh\); restore them"):
        is_finished(path, lost)
    other = make_stamp("refine-grasps", {}, inputs={"mesh": "sha256:1", "extra": MISSING})
    with pytest.raises(StaleOutputError, match="pass --overwrite"):
        is_finished(path, other)
