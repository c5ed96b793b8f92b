"""`inspect`: lists frames, and fails unreadable ones, without running a network."""

import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from pipelines import inspect_frames
from pipelines.configs import InspectConfig
from pipelines.errors import SymgraspError
from symgrasp_cli.app import app
from tests.frames.layouts import build

CONFIG = InspectConfig()


@pytest.fixture
def two_layouts(tmp_path: Path) -> Path:
    for name in ("bop_scene", "flat"):
        (tmp_path / name).mkdir()
        build.LAYOUTS[name][1](tmp_path / name)
    return tmp_path


def test_similar_frames_are_listed_together(two_layouts: Path) -> None:
    findings = inspect_frames.run(two_layouts, CONFIG)
    assert findings.found == {"BOP scene": 2, "flat pairs": 2}
    assert [len(group) for group in findings.groups] == [2, 2]
    text = "\n".join(inspect_frames.findings_lines(findings))
    assert "frames      2: bop_scene/000000 ... bop_scene/000001" in text
    assert "size        48x36" in text
    assert "intrinsics  fx 60, fy 61, cx 23.5, cy 17.5" in text
    assert "1000 units per metre" in text
    near, far = findings.groups[0][0].depth_range
    assert 0.49 < near < 0.52
    assert 0.88 < far < 0.91


def test_frames_of_another_camera_are_listed_separately(tmp_path: Path) -> None:
    build.flat(tmp_path)
    (tmp_path / "1_camera.json").write_text('{"fx": 70, "fy": 61, "cx": 23.5, "cy": 17.5}')
    assert len(inspect_frames.run(tmp_path, CONFIG).groups) == 2


def test_odd_properties_of_frames_are_reported(tmp_path: Path) -> None:
    build.flat(tmp_path)
    twice = np.repeat(np.repeat(build.color(0), 2, axis=0), 2, axis=1)
    build.image(tmp_path / "0_color.png", twice)
    text = "\n".join(inspect_frames.findings_lines(inspect_frames.run(tmp_path, CONFIG)))
    assert "colour of 96x72 is resampled to the depth (1x)" in text


def test_only_some_of_many_frames_are_read(tmp_path: Path) -> None:
    for i in range(9):
        build.pair(tmp_path / f"{i}_color.png", tmp_path / f"{i}_depth.png", i)
    (tmp_path / "intrinsics.txt").write_text("60 61 23.5 17.5")
    findings = inspect_frames.run(tmp_path, InspectConfig(max_frames=3))
    assert findings.report.done == ["0", "4", "8"]
    assert inspect_frames.findings_lines(findings)[:2] == [
        "9 frames as flat pairs",
        "3 of them were read, evenly spread",
    ]


def test_frames_that_cannot_be_read_fail_with_one_sentence(two_layouts: Path) -> None:
    (two_layouts / "flat/0_depth.png").write_bytes(b"")
    findings = inspect_frames.run(two_layouts, CONFIG)
    assert list(findings.report.failed) == ["flat/0"]
    assert len(findings.report.done) == 3
    with pytest.raises(SymgraspError, match="holds no RGB-D frames"):
        inspect_frames.run(two_layouts / "bop_scene/rgb", CONFIG)


def test_the_command_prints_on_stdout_and_writes_no_file(two_layouts: Path) -> None:
    before = sorted(two_layouts.rglob("*"))
    result = CliRunner().invoke(app, ["inspect", str(two_layouts), "--intrinsics", "60,61,23,17"])
    assert result.exit_code == 0
    assert "fx 60, fy 61, cx 23, cy 17" in result.stdout
    assert f"next: symgrasp infer {two_layouts} --intrinsics 60,61,23,17\n" in result.stderr
    assert sorted(two_layouts.rglob("*")) == before
    result = CliRunner().invoke(app, ["inspect", str(two_layouts), "--depth-units-per-metre", "1"])
    assert result.exit_code == 1
    assert "under 1000" in result.output


def test_no_network_is_loaded() -> None:
    import subprocess

    code = "import sys, pipelines.inspect_frames; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
