"""Grasp labels and collision labels in GraspNet's arrays."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.dataset.graspnet import graspnet_labels as labels
from pipelines.dataset.graspnet.graspnet_label_stream import read_grasp_label
from pipelines.dataset.graspnet.graspnet_views import view_rotations
from pipelines.errors import FormatError
from pipelines.storage import array_files


@pytest.fixture(scope="module")
def label() -> labels.GraspLabel:
    rng = np.random.default_rng(0)
    friction = np.full((2, *labels.LABEL_GRID), -1.0, np.float32)
    friction[0, 5, 3, 1], friction[1, 250, 11, 3], friction[1, 7, 0, 0] = 0.3, 1.0, 0.4
    collision = np.zeros(friction.shape, bool)
    collision[1, 7, 0, 0] = True
    width = rng.uniform(0.02, 0.1, friction.shape)
    points = rng.normal(size=(2, 3)).astype(np.float32)
    return labels.GraspLabel(points, labels.label_offsets(width), collision, friction)


def test_a_label_comes_back_under_the_originals_names(
    tmp_path: Path, label: labels.GraspLabel
) -> None:
    path = tmp_path / "000_labels.npz"
    labels.write_grasp_label(path, label)
    with np.load(path) as stored:
        assert sorted(stored.files) == ["collision", "offsets", "points", "scores"]
        assert stored["offsets"].shape == (2, 300, 12, 4, 3)
        assert stored["scores"].dtype == np.float32
        assert stored["collision"].dtype == bool
    again = read_grasp_label(path)
    assert_array_equal(again.min_friction, label.min_friction)
    assert_array_equal(again.offsets, label.offsets)


def test_offsets_are_angle_depth_width(label: labels.GraspLabel) -> None:
    angle, depth, _ = label.offsets[0, 5, 3, 1]
    assert_allclose([angle, depth], [3 * np.pi / 12, 0.02], rtol=1e-6)


def test_holding_grasps_are_in_force_closure_and_free_of_collision(
    label: labels.GraspLabel,
) -> None:
    grasps = labels.holding_grasps(label)
    assert_array_equal(grasps.index, [[0, 5, 3, 1], [1, 250, 11, 3]])
    assert_allclose(grasps.min_friction, [0.3, 1.0])
    assert_allclose(grasps.depth, [0.02, 0.04])
    assert_array_equal(grasps.origin, label.points)
    assert_allclose(grasps.rotation[0], view_rotations()[5, 3], atol=1e-6)


def test_a_friction_limit_leaves_only_better_grasps(label: labels.GraspLabel) -> None:
    assert len(labels.holding_grasps(label, 0.3)) == 1
    assert len(labels.holding_grasps(label, 0.2)) == 0


def test_collision_labels_keep_their_order(tmp_path: Path) -> None:
    # Eleven objects: arr_10 sorts before arr_2 as text.
    arrays = [np.full((i % 2 + 1, *labels.LABEL_GRID), i % 3 == 0) for i in range(11)]
    labels.write_collision_labels(tmp_path / "collision_labels.npz", arrays)
    again = labels.read_collision_labels(tmp_path / "collision_labels.npz")
    assert len(again) == 11
    for stored, array in zip(again, arrays, strict=True):
        assert_array_equal(stored, array)


def test_collision_labels_are_bounded_by_object_and_not_by_scene(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "collision_labels.npz"
    labels.write_collision_labels(path, [np.ones((1, *labels.LABEL_GRID), bool)] * 3)
    one = 300 * 12 * 4 + 1000  # bytes, with the header
    monkeypatch.setattr(array_files, "MAX_UNPACK_BYTES", 2 * one)
    monkeypatch.setattr(labels, "MAX_COLLISION_BYTES", one)
    assert len(labels.read_collision_labels(path)) == 3
    labels.write_collision_labels(path, [np.ones((2, *labels.LABEL_GRID), bool)])
    with pytest.raises(FormatError, match=r"bytes in one array; at most 15400 are read"):
        labels.read_collision_labels(path)


def test_a_truncated_label_is_reported_in_one_sentence(
    tmp_path: Path, label: labels.GraspLabel
) -> None:
    path = tmp_path / "000_labels.npz"
    labels.write_grasp_label(path, label)
    path.write_bytes(path.read_bytes()[:-300])
    with pytest.raises(FormatError, match="000_labels"):
        read_grasp_label(path)


def test_a_label_of_other_shape_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "000_labels.npz"
    arrays = {name: np.zeros((2, 3)) for name in labels.LABEL_ARRAYS}
    np.savez(path, **{**arrays, "collision": np.zeros((2, 3), bool)})
    with pytest.raises(FormatError, match="offsets"):
        read_grasp_label(path)


def test_planar_grasps_have_seven_columns(tmp_path: Path) -> None:
    labels.write_rect(tmp_path / "0000.npy", np.ones((4, 7)))
    assert labels.read_rect(tmp_path / "0000.npy").dtype == np.float32
    np.save(tmp_path / "bad.npy", np.ones((4, 17)))
    with pytest.raises(FormatError, match="17"):
        labels.read_rect(tmp_path / "bad.npy")
