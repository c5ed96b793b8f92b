"""The refine-grasps stage on a box, a can, and a ball joined to a box."""

import shutil

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipelines import annotate_symmetry, refine_grasps
from pipelines.batch import BatchOptions
from pipelines.configs import AnnotateSymmetryConfig, RefineGraspsConfig
from pipelines.formats import affordance_labels, symmetry_labels
from pipelines.formats.graspnet import GraspLabel, GraspNetRoot, read_grasp_label, write_grasp_label
from pipelines.formats.meshes import read_mesh
from pipelines.geometry.surface import Surface
from pipelines.geometry.symmetry import RotationSymmetry
from tests.stages.dataset_root import write_root

ANNOTATE = AnnotateSymmetryConfig(num_samples=8000, num_verification_samples=1000)
CONFIG = RefineGraspsConfig(copies_per_turn=12, num_surface_points=1024)
QUIET = BatchOptions(progress=False)


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    made = write_root(tmp_path_factory.mktemp("root"), num_frames=1)
    annotate_symmetry.run(made.root, None, ANNOTATE, options=QUIET)
    refine_grasps.run(made.root, CONFIG, options=QUIET)
    return made


def refined(root, object_id, config=CONFIG, label=None):
    return refine_grasps.refine(
        read_mesh(root.model_path(object_id)),
        label or read_grasp_label(root.grasp_label_path(object_id)),
        symmetry_labels.read(root.symmetry_path(object_id)),
        config,
        np.random.default_rng(0),
    )


def test_every_object_gets_its_file(root):
    labels = [affordance_labels.read(root.affordance_path(i)) for i in range(3)]
    assert all(len(label.quality) > 100 for label in labels)
    assert all(len(label.affordance) == CONFIG.num_surface_points for label in labels)


def test_every_contact_lies_on_the_mesh(root):
    for object_id in range(3):
        labels = affordance_labels.read(root.affordance_path(object_id))
        mesh = read_mesh(root.model_path(object_id))
        surface = Surface.from_mesh(mesh, 20000, np.random.default_rng(1))
        gap = surface.distances(np.asarray(labels.contacts, float).reshape(-1, 3))[0]
        assert gap.max() <= CONFIG.max_surface_gap + 1e-3


def test_symmetry_gives_more_points_an_affordance(root):
    alone, _ = refined(root, 1, RefineGraspsConfig(use_symmetry=False, num_surface_points=1024))
    copied, _ = refined(root, 1)
    assert len(copied.quality) > 5 * len(alone.quality)
    assert np.count_nonzero(copied.affordance) > np.count_nonzero(alone.affordance)


def test_the_affordance_of_a_can_is_nearly_the_same_all_around(root):
    labels = affordance_labels.read(root.affordance_path(1))
    axis = next(
        symmetry
        for symmetry in symmetry_labels.read(root.symmetry_path(1)).symmetries
        if isinstance(symmetry, RotationSymmetry)
    )
    side = np.abs(labels.normals @ axis.axis) < 0.5
    middle = side & (np.abs((labels.points - axis.point) @ axis.axis) < 0.03)
    assert np.count_nonzero(labels.affordance[middle]) > 0.9 * middle.sum()


def test_copies_keep_the_friction_of_their_originals(root):
    alone, _ = refined(root, 0, RefineGraspsConfig(use_symmetry=False, num_surface_points=1024))
    copied, _ = refined(root, 0)
    assert set(np.unique(copied.quality)) == set(np.unique(alone.quality))
    assert_allclose(copied.quality[: len(alone.quality)], alone.quality)


def test_infeasible_and_colliding_candidates_are_left_out(root):
    label = read_grasp_label(root.grasp_label_path(0))
    blocked = GraspLabel(
        label.points, label.offsets, np.ones_like(label.collision), label.min_friction
    )
    labels, note = refined(root, 0, label=blocked)
    assert len(labels.quality) == 0
    assert not labels.affordance.any()
    assert note.startswith("0 labelled grasps")


def test_working_through_a_label_in_pieces_changes_nothing(root):
    whole, _ = refined(root, 1)
    config = RefineGraspsConfig(copies_per_turn=12, num_surface_points=1024, chunk=14400)
    pieces, _ = refined(root, 1, config)
    assert_allclose(np.sort(pieces.quality), np.sort(whole.quality))
    assert_allclose(pieces.affordance, whole.affordance)


def test_a_region_is_copied_by_its_own_symmetry_alone(root):
    labels = affordance_labels.read(root.affordance_path(2))
    assert len(labels.quality) > 1000
    assert np.count_nonzero(labels.affordance) > 0.8 * len(labels.affordance)


def test_a_label_that_is_missing_fails_alone_and_names_its_command(root, tmp_path):
    other = GraspNetRoot(shutil.copytree(root.root, tmp_path / "copy"))
    other.symmetry_path(1).unlink()
    shutil.rmtree(other.affordance_path(0).parent)
    report = refine_grasps.run(other.root, CONFIG, options=QUIET)
    assert report.done == ["000", "002"]
    assert "annotate-symmetry" in report.failed["001"]
    assert report.exit_code == 1


def test_a_changed_grasp_label_makes_the_affordance_stale(root, tmp_path):
    other = GraspNetRoot(shutil.copytree(root.root, tmp_path / "copy"))
    label = read_grasp_label(other.grasp_label_path(0))
    write_grasp_label(
        other.grasp_label_path(0),
        GraspLabel(label.points + 0.001, label.offsets, label.collision, label.min_friction),
    )
    report = refine_grasps.run(other.root, CONFIG, options=QUIET)
    assert list(report.failed) == ["000"]
    assert report.skipped == ["001", "002"]
