"""Contact-GraspNet's predictions: its axes, its origin, its segments."""

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipelines.grasp_files.exports import contact_graspnet_predictions as predictions
from pipelines.storage.array_files import read_npz
from tests.grasp_files.exports.gripper_toys import numbered, random_frame

DOCUMENT = Path(__file__).resolve().parents[3] / "docs/reference/formats.md"


@pytest.fixture
def frame(tmp_path, monkeypatch):
    frame, header = random_frame(np.random.default_rng(3), 6, name="x")
    predictions.write_frame(tmp_path / "predictions_x.npz", frame, header)
    monkeypatch.chdir(tmp_path)
    return frame


def test_axes_are_closing_axis_cross_product_and_approach_axis(frame):
    arrays = read_npz(Path("predictions_x.npz"))
    region = frame.result.grasps.region
    for segment in np.unique(region):
        poses = arrays[f"pred_grasps_cam/{segment + 1}"]
        grasps = frame.grasps[region == segment]
        assert_allclose(poses[:, :3, 0], grasps.closing)
        assert_allclose(poses[:, :3, 2], grasps.approach)
        assert_allclose(poses[:, :3, 1], np.cross(grasps.approach, grasps.closing))
        first, width = arrays[f"contact_pts/{segment + 1}"], grasps.width[:, None]
        base = float(arrays["base_to_contacts"])
        origin = first + width / 2 * grasps.closing - base * grasps.approach
        assert_allclose(poses[:, :3, 3], origin, atol=1e-7)


def test_the_documented_lines_give_contact_graspnets_own_dicts(frame):
    section = DOCUMENT.read_text(encoding="utf-8").split("## Contact-GraspNet predictions")[1]
    code = re.search(r"```python\n(.*?)```", section, re.DOTALL)[1]
    exec(compile(code, "formats.md", "exec"), {})  # the project's own text
    # The tool's programs load it so; the pickle was made three lines ago.
    with np.load("predictions_x.pickled.npz", allow_pickle=True) as found:
        poses, scores = found["pred_grasps_cam"].item(), found["scores"].item()
        points = found["contact_pts"].item()
    region = frame.result.grasps.region
    assert set(poses) == set(scores) == set(points) == set((np.unique(region) + 1).tolist())
    for segment, found_poses in poses.items():
        assert len(found_poses) == (region == segment - 1).sum()
        assert_allclose(scores[segment], frame.result.grasps.rank_score[region == segment - 1])


def test_grasps_outside_of_the_users_masks_are_background(tmp_path):
    frame, header = random_frame(np.random.default_rng(3), 9, name="x")
    assert set(frame.result.grasps.region) == {0, 1, 2}
    predictions.write_frame(tmp_path / "p.npz", numbered(frame, (3, 1, -1)), header)
    with np.load(tmp_path / "p.npz") as arrays:
        segments = {name for name in arrays.files if name.startswith("scores/")}
    assert segments == {"scores/0", "scores/1", "scores/3"}


def test_a_frame_without_grasps_has_no_segments(tmp_path):
    frame, header = random_frame(np.random.default_rng(3), 0, name="x")
    predictions.write_frame(tmp_path / "predictions_x.npz", frame, header)
    assert set(read_npz(tmp_path / "predictions_x.npz")) == {"base_to_contacts"}
