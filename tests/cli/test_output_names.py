"""Names of outputs: refused where a stamp could not be found again; links are followed."""

import json

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from pipelines.storage.provenance import read_stamp
from symgrasp_cli.app import app


@pytest.mark.parametrize(
    ("command", "suffix"),
    [
        ("simulate {file} --dataset {folder}", ".json"),
        ("evaluate {file} --dataset {folder}", ".json"),
        ("evaluate {folder} --dataset {folder} --protocol graspnet", ".json"),
        ("score-grasps {file} {file}", ".npz"),
    ],
)
@pytest.mark.parametrize("name", ["out", "out.txt"])
def test_an_output_of_another_suffix_is_wrong_usage(command, suffix, name, tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_bytes(b"never read")
    places = {each: str(tmp_path / each) for each in ("file", "folder")}
    arguments = [part.format(**places) for part in command.split()]
    result = CliRunner().invoke(app, [*arguments, "--out", str(tmp_path / name)])
    assert result.exit_code == 2, result.output
    assert result.stderr.startswith("error: --out is ")
    assert f"ends in {suffix}" in result.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder"]


def test_grasps_are_not_written_under_the_name_of_a_picture(tmp_path):
    result = CliRunner().invoke(app, ["infer", str(tmp_path), "--out", str(tmp_path / "a.png")])
    assert result.exit_code == 2
    words = " ".join(result.output.replace("│", "").split())  # typer wraps lines in a box
    assert "must be a file name that ends in .h5" in words


@pytest.mark.parametrize("exists", [True, False])
def test_an_output_that_is_a_link_is_written_where_the_link_leads(exists, tmp_path):
    trimesh.creation.box((0.04, 0.04, 0.04)).export(tmp_path / "box.ply")
    row = [0.5, 0.06, 0.02, 0.02, *np.eye(3).ravel(), 0, 0, 0, -1]
    np.save(tmp_path / "grasps.npy", np.array([row]))
    command = ["score-grasps", str(tmp_path / "box.ply"), str(tmp_path / "grasps.npy"), "--out"]
    link, behind = tmp_path / "here" / "link.npz", tmp_path / "disk" / "scores.npz"
    link.parent.mkdir()
    link.symlink_to("../disk/scores.npz")
    if exists:
        assert CliRunner().invoke(app, [*command, str(behind)]).exit_code == 0
    result = CliRunner().invoke(app, [*command, str(link), "--overwrite", "--json"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["outputs"] == [str(behind)]
    assert link.is_symlink()
    assert read_stamp(behind)["stage"] == "score-grasps"
    assert [path.name for path in link.parent.iterdir()] == ["link.npz"]
    assert "1 skipped" in CliRunner().invoke(app, [*command, str(link)]).stderr
