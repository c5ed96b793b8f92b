"""Summary of a grasps.h5: counts, and the frames without a grasp with their reason."""

from pathlib import Path

import cv2
import numpy as np
from typer.testing import CliRunner

from pipelines.grasp_files.grasps_summary import NAMED, GraspsSummary, summary_of
from symgrasp_cli.app import app

FRAMES = Path(__file__).resolve().parents[2] / "pipelines" / "weights" / "frames"


def test_frames_without_a_grasp_are_counted_by_reason_and_only_some_are_named():
    empty = {f"f{i}": "nothing stands out" for i in range(NAMED + 2)} | {"g": "no table"}
    lines = list(GraspsSummary(frames=10, grasps=7, empty=empty, failed=1).lines())
    assert lines == [
        "7 grasps on 1 of 10 frames",
        "no grasp: f0, f1, f2, f3, f4 and 2 more: nothing stands out",
        "no grasp: g: no table",
    ]


def test_infer_ends_with_counts_of_grasps_empty_frames_and_the_next_command(tmp_path):
    frames, output = tmp_path / "frames", tmp_path / "grasps.h5"
    frames.mkdir()
    for path in FRAMES.glob("table_1*"):
        (frames / path.name).write_bytes(path.read_bytes())
        (frames / path.name.replace("table_1", "wall")).write_bytes(path.read_bytes())
    depth = cv2.imread(str(frames / "wall_depth.png"), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(frames / "wall_depth.png"), np.full_like(depth, 900))
    command = ["infer", str(frames), "--out", str(output), "--method", "planar"]
    result = CliRunner().invoke(app, [*command, "--regions", "geometric"])
    assert result.exit_code == 0, result.output
    summary = summary_of(output)
    lines = result.stderr.splitlines()
    assert summary.frames == 2
    assert list(summary.empty) == ["wall"]
    assert lines[-4:] == [
        f"{summary.grasps} grasps on 1 of 2 frames",
        f"no grasp: wall: {summary.empty['wall']}",
        f"output: {output}",
        f"next: symgrasp view {output} --out view",
    ]
    assert not [line for line in lines if line.startswith("wall: ")]
