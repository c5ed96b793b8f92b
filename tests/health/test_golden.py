"""Grasps compared with the expected grasps, within the stated tolerances."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipelines.configs import DoctorConfig
from pipelines.health import golden
from pipelines.health.checks import Status
from pipelines.storage.weights_manifest import GoldenGrasps, Manifest

CONFIG = DoctorConfig()


def grasps(count=8):
    rotation = Rotation.random(count, rng=np.random.default_rng(0)).as_matrix()
    places = np.arange(3.0 * count).reshape(-1, 3)
    return GoldenGrasps(rotation, places, np.full(count, 0.05))


def test_a_grasp_within_the_tolerances_agrees_and_one_beyond_does_not():
    expected = grasps()
    along = np.array([1.0, 0, 0])
    turned = expected.rotation @ Rotation.from_rotvec(along).as_matrix()
    for other, same in (
        (replace(expected, translation=expected.translation + 0.9 * CONFIG.max_shift * along), 1),
        (replace(expected, translation=expected.translation + 1.1 * CONFIG.max_shift * along), 0),
        (replace(expected, width=expected.width + 1.1 * CONFIG.max_shift), 0),
        (replace(expected, rotation=expected.rotation @ np.diag([1.0, -1, -1])), 1),
        (replace(expected, rotation=expected.rotation @ np.diag([-1.0, -1, 1])), 0),
        (replace(expected, rotation=turned), 0),
    ):
        np.testing.assert_array_equal(golden.agree(other, expected, CONFIG), np.full(8, bool(same)))


def test_no_grasp_agrees_with_none():
    assert not golden.agree(grasps(0), grasps(), CONFIG).any()


@pytest.mark.parametrize(
    ("moved", "device", "status"),
    [(1, "cpu", Status.OK), (2, "cpu", Status.FAIL), (2, "cuda", Status.WARN)],
)
def test_one_region_in_eight_may_differ(monkeypatch, moved, device, status):
    found = grasps()
    found.translation[:moved] += 0.01
    monkeypatch.setattr(golden, "golden_result", lambda *arguments: None)
    monkeypatch.setattr(golden, "best_grasps", lambda result: found)
    check = golden.golden_check(Manifest({}, "f", grasps()), CONFIG, device)
    assert check.status is status
    assert f"f: {8 - moved} of 8 grasps as expected, within 1 mm and 2 degrees" in check.text
