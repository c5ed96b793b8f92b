"""The commands of the guide from a RealSense recording to grasps."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from pipelines.storage.files import write_json
from pipelines.storage.images import read_image, write_image
from symgrasp_cli.app import app

ROOT = Path(__file__).resolve().parents[2]
GUIDE = ROOT / "docs" / "how-to" / "realsense.md"
FRAMES = ROOT / "pipelines" / "weights" / "frames"


def write_recording(folder: Path) -> None:
    """Write every other pixel of a bundled frame, as Open3D's recorder for RealSense does."""
    camera = json.loads((FRAMES / "table_1_camera.json").read_text())
    color, depth = (read_image(FRAMES / f"table_1_{kind}.png") for kind in ("color", "depth"))
    depth = np.round(depth[::2, ::2] * (1000.0 / camera["depth_scale"])).astype(np.uint16)
    write_image(folder / "color" / "000000.jpg", color[::2, ::2])
    write_image(folder / "depth" / "000000.png", depth)
    fx, fy, cx, cy = (camera[name] / 2 for name in ("fx", "fy", "cx", "cy"))
    size = {"width": depth.shape[1], "height": depth.shape[0]}
    columns = [fx, 0, 0, 0, fy, 0, cx, cy, 1]
    write_json(folder / "camera_intrinsic.json", {**size, "intrinsic_matrix": columns})


def test_the_commands_lead_from_a_recording_to_json(tmp_path, monkeypatch):
    blocks = re.findall(r"^```(\w*)\n(.*?)^```$", GUIDE.read_text("utf-8"), re.M | re.S)
    commands = next(text for kind, text in blocks if not kind)
    example = next(text for kind, text in blocks if kind == "json")
    write_recording(tmp_path / "my_recording")
    monkeypatch.chdir(tmp_path)
    for command in commands.splitlines():
        result = CliRunner().invoke(app, shlex.split(command)[1:])
        assert result.exit_code == 0, result.output
    assert list(Path("pictures").glob("*.png"))
    (frame,) = json.loads(Path("grasps.json").read_text(encoding="utf-8"))["frames"]
    shown = json.loads(example)
    assert set(shown) <= set(frame)
    assert set(shown["grasps"][0]) <= set(frame["grasps"][0])
    x, y, z = np.mean([grasp["contacts"] for grasp in frame["grasps"]], axis=1).T
    camera = frame["camera"]
    u, v = camera["fx"] * x / z + camera["cx"], camera["fy"] * y / z + camera["cy"]
    assert ((u > 0) & (u < camera["width"]) & (v > 0) & (v < camera["height"])).all()
