"""Refusal, before any work, of output names whose stamp could not be found again."""

import pytest
from typer.testing import CliRunner

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
