"""The pack stage: region clouds whose labels are those of the posed objects."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from pipelines import annotate_symmetry, pack, refine_grasps
from pipelines.batch import BatchOptions
from pipelines.configs import AnnotateSymmetryConfig, PackConfig, RefineGraspsConfig
from pipelines.errors import SymgraspError
from pipelines.formats import packed_regions, symmetry_labels
from pipelines.formats.meshes import read_mesh
from pipelines.geometry.surface import Surface
from pipelines.geometry.symmetry import SymmetrySlots
from pipelines.geometry.transforms import invert, transform_points
from tests.stages.dataset_root import write_root

QUIET = BatchOptions(progress=False)
CONFIG = PackConfig(num_points=256, min_pixels=100)
NAME = "scene_0000_realsense"


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    made = write_root(tmp_path_factory.mktemp("root"))
    annotate = AnnotateSymmetryConfig(num_samples=8000, num_verification_samples=1000)
    annotate_symmetry.run(made.root, None, annotate, options=QUIET)
    refine = RefineGraspsConfig(copies_per_turn=12, num_surface_points=1024)
    refine_grasps.run(made.root, refine, options=QUIET)
    return made


@pytest.fixture(scope="module")
def packed(root, tmp_path_factory):
    out = tmp_path_factory.mktemp("packed")
    pack.run(root.root, out, CONFIG, options=QUIET)
    return packed_regions.read(out / f"{NAME}.h5")


def poses_of(root, frame_id):
    frame = root.scene(0).frame(frame_id)
    return {pose.object_id: pose.T_cam_obj for pose in root.read_annotation(frame)}


def test_every_visible_region_of_every_frame_is_there(packed):
    found = {
        (int(frame), int(object_id), str(name))
        for frame, object_id, name in zip(
            packed.frame_id, packed.object_id, packed.name, strict=True
        )
    }
    for frame in (0, 1):
        assert {(frame, 0, "whole"), (frame, 1, "whole"), (frame, 2, "part0")} <= found


def test_nothing_is_nan_but_empty_slots(packed):
    assert np.isfinite(packed.points).all()
    assert ((packed.affordance >= 0) & (packed.affordance <= 1)).all()
    full = packed.existence > 0.5
    assert np.isfinite(packed.point[full]).all()
    assert np.isnan(packed.point[~full]).all()


def test_most_points_lie_on_their_posed_object(root, packed):
    for row in range(len(packed)):
        object_id = int(packed.object_id[row])
        pose = poses_of(root, int(packed.frame_id[row]))[object_id]
        mesh = read_mesh(root.model_path(object_id))
        surface = Surface.from_mesh(mesh, 20000, np.random.default_rng(0))
        points_obj = transform_points(invert(pose), packed.points[row])
        assert np.mean(surface.distances(points_obj)[0] < 0.003) > 0.6


def test_symmetries_are_the_objects_moved_by_its_pose(root, packed):
    for row in range(len(packed)):
        object_id = int(packed.object_id[row])
        pose = poses_of(root, int(packed.frame_id[row]))[object_id]
        regions = symmetry_labels.read(root.symmetry_path(object_id)).regions
        region = next(region for region in regions if region.name == packed.name[row])
        expected = SymmetrySlots.from_symmetries(region.symmetries).transformed(pose)
        assert_array_equal(packed.existence[row], expected.existence)
        assert_allclose(packed.point[row], expected.point, atol=1e-6)
        assert_allclose(packed.direction[row], expected.direction, atol=1e-6)


def test_points_that_leak_out_of_the_object_have_no_affordance(root, packed):
    for row in range(len(packed)):
        object_id = int(packed.object_id[row])
        pose = poses_of(root, int(packed.frame_id[row]))[object_id]
        mesh = read_mesh(root.model_path(object_id))
        surface = Surface.from_mesh(mesh, 20000, np.random.default_rng(0))
        points_obj = transform_points(invert(pose), packed.points[row])
        away = surface.distances(points_obj)[0] > CONFIG.label_radius + 0.002
        assert not packed.affordance[row][away].any()


def test_the_same_seed_packs_the_same_bytes_and_another_does_not(root, tmp_path):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        pack.run(root.root, tmp_path / name, CONFIG, seed=seed, options=QUIET)
    files = [(tmp_path / name / f"{NAME}.h5").read_bytes() for name in "abc"]
    assert files[0] == files[1]
    assert files[0] != files[2]


def test_exact_masks_hold_points_of_the_region_alone(root, tmp_path):
    config = PackConfig(num_points=256, min_pixels=100, mask_noise=False)
    pack.run(root.root, tmp_path, config, options=QUIET)
    scene = packed_regions.read(tmp_path / f"{NAME}.h5")
    for row in range(len(scene)):
        object_id = int(scene.object_id[row])
        pose = poses_of(root, int(scene.frame_id[row]))[object_id]
        mesh = read_mesh(root.model_path(object_id))
        surface = Surface.from_mesh(mesh, 20000, np.random.default_rng(0))
        points_obj = transform_points(invert(pose), scene.points[row])
        assert np.mean(surface.distances(points_obj)[0] < 0.003) > 0.97


def test_regions_that_show_too_little_are_left_out(root, tmp_path):
    pack.run(root.root, tmp_path, PackConfig(min_pixels=10**6), options=QUIET)
    assert len(packed_regions.read(tmp_path / f"{NAME}.h5")) == 0


def test_a_finished_scene_is_skipped(root, tmp_path):
    pack.run(root.root, tmp_path, CONFIG, options=QUIET)
    assert pack.run(root.root, tmp_path, CONFIG, options=QUIET).skipped == [NAME]


def test_a_split_without_scenes_is_one_sentence(root, tmp_path):
    with pytest.raises(SymgraspError, match="novel scene"):
        pack.run(root.root, tmp_path, CONFIG, split="novel", options=QUIET)
