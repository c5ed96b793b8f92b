"""A dataset whose objects have their true depth."""

import numpy as np
import pytest

from pipelines.dataset.graspnet.graspnet import GraspNetRoot, write_depth
from pipelines.errors import SymgraspError
from pipelines.storage.provenance import make_stamp, read_stamp, write_sidecar
from tests.stages.toy_root import frame_names, write_root
from tools.true_depth import copy_with_true_depth


def test_objects_get_their_depth_back_and_all_else_stays(tmp_path):
    root = write_root(tmp_path / "root")
    true = {name: root.read_depth(root.frame(name))[0] for name in frame_names()}
    noisy = {}
    for seed, name in enumerate(frame_names()):
        rng, frame = np.random.default_rng(seed), root.frame(name)
        wrong = true[name] + rng.normal(0.0, 0.004, true[name].shape)
        wrong[rng.random(wrong.shape) < 0.1] = 0.0
        write_depth(frame.path("depth"), wrong)
        noisy[name] = root.read_depth(frame)[0]
    scene = root.scene_folder(root.scene_ids()[0])
    write_sidecar(scene, make_stamp("synthesize", {}))
    assert copy_with_true_depth(root.root, tmp_path / "true") == len(frame_names())
    copied = GraspNetRoot(tmp_path / "true")
    assert read_stamp(copied.scene_folder(root.scene_ids()[0]))["stage"] == "true_depth"
    assert read_stamp(scene)["stage"] == "synthesize"
    for name in frame_names():
        frame = copied.frame(name)
        depth, objects = copied.read_depth(frame)[0], copied.read_label(frame) > 0
        np.testing.assert_array_equal(depth > 0, noisy[name] > 0)
        np.testing.assert_array_equal(depth[~objects], noisy[name][~objects])
        error = np.abs(depth - true[name])[objects & (depth > 0)]
        assert len(error) > 100
        assert error.max() <= 0.0011  # millimetres in the file
        np.testing.assert_array_equal(root.read_depth(root.frame(name))[0], noisy[name])


def test_an_existing_folder_is_refused(tmp_path):
    root = write_root(tmp_path / "root")
    with pytest.raises(SymgraspError, match="exists"):
        copy_with_true_depth(root.root, root.root)
