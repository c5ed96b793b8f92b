"""The refine-grasps stage on a box, a can, and a ball joined to a box."""

import json
import shutil
from dataclasses import replace

import h5py
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pipelines import annotate_symmetry, refine_grasps
from pipelines.configs import AnnotateSymmetryConfig, RefineGraspsConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_label_stream import grasp_label_pieces, read_grasp_label
from pipelines.dataset.graspnet.graspnet_labels import GraspLabel, write_grasp_label
from pipelines.dataset.meshes import read_mesh, write_mesh
from pipelines.dataset.symmetry import symmetry_labels
from pipelines.dataset.symmetry.symmetry_labels import ObjectSymmetries
from pipelines.dataset.training import affordance_labels
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.symmetry import (
    ObjectRegion,
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
)
from pipelines.geometry.transforms import random_rotation
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.rated_grasps import RatedGrasps
from pipelines.mesh_symmetry.surface.sampled_surface import Surface
from pipelines.metrics.contacts import close_fingers
from pipelines.metrics.force_closure import min_friction
from pipelines.refinement.copies import Copier, point_affordance
from pipelines.runtime.batch import BatchOptions
from pipelines.storage.provenance import digest, make_stamp, write_sidecar
from tests.stages.dataset_root import write_root

ANNOTATE = AnnotateSymmetryConfig(
    num_samples=8000, num_verification_samples=1000, plane_directions=400, axis_directions=250
)
CONFIG = RefineGraspsConfig(copies_per_turn=12, num_surface_points=1024)
QUIET = BatchOptions(progress=False)


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    made = write_root(tmp_path_factory.mktemp("root"), num_frames=1)
    annotate_symmetry.run(made.root, None, ANNOTATE, options=QUIET)
    refine_grasps.run(made.root, CONFIG, options=QUIET)
    return made


def refined(root, object_id, config=CONFIG, label=None):
    path = root.grasp_label_path(object_id)
    return refine_grasps.refine(
        read_mesh(root.model_path(object_id)),
        grasp_label_pieces(path, config.chunk // 14400) if label is None else [label],
        symmetry_labels.read(root.symmetry_path(object_id)),
        config,
    )


def test_every_object_gets_its_file(root):
    labels = [affordance_labels.read(root.affordance_path(i)) for i in range(3)]
    assert all(len(label.quality) > 100 for label in labels)
    assert all(len(label.affordance) == CONFIG.num_surface_points for label in labels)


def test_a_mesh_with_inward_normals_is_turned_and_another_mesh_fails(root, tmp_path, caplog):
    shutil.copytree(root.root, tmp_path / "root")
    copy = GraspNetRoot(tmp_path / "root")
    inward, other = (copy.model_path(i) for i in (0, 1))
    mesh = read_mesh(inward)
    write_mesh(inward, replace(mesh, faces=mesh.faces[:, ::-1]))
    far = read_mesh(other)
    write_mesh(other, replace(far, vertices=far.vertices + 1.0))
    for path in (copy.symmetry_path(i) for i in (0, 1)):  # as if written by hand
        path.write_text(json.dumps(json.loads(path.read_text()) | {"provenance": None}))
    options = replace(QUIET, overwrite=True)
    report = refine_grasps.run(copy.root, CONFIG, options=options)
    assert list(report.failed) == ["001"]
    assert "labelled grasps meets the mesh" in report.failed["001"]
    assert "turned its triangles, which looked inward" in caplog.text
    found, expected = (affordance_labels.read(each.affordance_path(0)) for each in (copy, root))
    assert len(found.quality) == pytest.approx(len(expected.quality), rel=0.05)
    assert np.mean(found.affordance > 0) == pytest.approx(np.mean(expected.affordance > 0), abs=0.1)


def test_symmetries_and_grasps_of_a_mesh_that_was_replaced_since_are_refused(root, tmp_path):
    copy = GraspNetRoot(shutil.copytree(root.root, tmp_path / "root"))
    shutil.rmtree(copy.affordance_path(0).parent)
    for i in (0, 1):
        mesh, label = copy.model_path(i), copy.grasp_label_path(i)
        write_sidecar(label, make_stamp("label-grasps", {}, inputs={mesh.name: digest(mesh)}))
        scaled = read_mesh(mesh)
        write_mesh(mesh, replace(scaled, vertices=1.01 * scaled.vertices))
    path = copy.symmetry_path(1)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"provenance": None}))
    report = refine_grasps.run(copy.root, CONFIG, options=QUIET)
    assert report.done == ["002"]
    assert "000.json: it was made with another file" in report.failed["000"]
    assert report.failed["000"].endswith("annotate it again")
    assert "001_labels.npz: it was made with another file" in report.failed["001"]
    assert report.failed["001"].endswith("label it again")


def test_every_contact_lies_on_the_mesh(root):
    for object_id in range(3):
        labels = affordance_labels.read(root.affordance_path(object_id))
        mesh = read_mesh(root.model_path(object_id))
        surface = Surface.from_mesh(mesh, 20000, np.random.default_rng(1))
        gap = surface.distances(np.asarray(labels.contacts, float).reshape(-1, 3))[0]
        assert gap.max() <= CONFIG.max_surface_gap + 1e-3


def test_symmetry_gives_more_points_an_affordance(root):
    alone = refined(root, 1, RefineGraspsConfig(use_symmetry=False, num_surface_points=1024))
    copied = refined(root, 1)
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
    alone = refined(root, 0, RefineGraspsConfig(use_symmetry=False, num_surface_points=1024))
    copied = refined(root, 0)
    assert set(np.unique(copied.quality)) == set(np.unique(alone.quality))
    assert_allclose(copied.quality[: len(alone.quality)], alone.quality)


def test_infeasible_and_colliding_candidates_are_left_out(root):
    label = read_grasp_label(root.grasp_label_path(0))
    blocked = GraspLabel(
        label.points, label.offsets, np.ones_like(label.collision), label.min_friction
    )
    labels = refined(root, 0, label=blocked)
    assert len(labels.quality) == 0
    assert not labels.affordance.any()
    assert labels.counts.num_labelled == labels.counts.num_points_after == 0


def test_reading_a_label_in_pieces_does_not_change_the_result(root):
    whole = refined(root, 1)
    config = RefineGraspsConfig(copies_per_turn=12, num_surface_points=1024, chunk=14400)
    pieces = refined(root, 1, config)
    assert_allclose(np.sort(pieces.quality), np.sort(whole.quality))
    assert_allclose(pieces.affordance, whole.affordance)


def test_grasps_of_a_region_are_copied_only_by_its_own_symmetry(root):
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


def test_pack_is_next_only_where_there_are_scenes_to_train_on(root, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(root.root, copy)
    assert refine_grasps.run(copy, CONFIG, options=QUIET).has_next
    (copy / "scenes" / "scene_0000").rename(copy / "scenes" / "scene_0100")
    assert not refine_grasps.run(copy, CONFIG, options=QUIET).has_next
    shutil.rmtree(copy / "scenes")
    assert not refine_grasps.run(copy, CONFIG, options=QUIET).has_next


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


def test_the_counts_hold_the_outcomes_of_the_grasps(root):
    labels = affordance_labels.read(root.affordance_path(1))
    counts = labels.counts
    assert counts == refined(root, 1).counts
    assert counts.num_labelled >= counts.num_distinct >= counts.num_originals > 0
    assert counts.num_originals + counts.num_copies == len(labels.quality)
    assert counts.num_points_before < counts.num_points_after
    assert counts.num_points_after == np.count_nonzero(labels.affordance)
    with h5py.File(root.affordance_path(1)) as file:
        assert file.attrs["num_copies"] == counts.num_copies


def test_the_originals_come_first(root):
    alone = refined(root, 0, RefineGraspsConfig(use_symmetry=False, num_surface_points=1024))
    labels = affordance_labels.read(root.affordance_path(0))
    assert_allclose(labels.contacts[: labels.counts.num_originals], alone.contacts, atol=1e-7)


def test_at_most_the_documented_numbers_are_kept(root):
    config = RefineGraspsConfig(max_grasps=100, max_copies=70, num_surface_points=1024)
    labels = refined(root, 0, config)
    assert labels.counts.num_originals == 100
    assert 0 < labels.counts.num_copies <= 70
    assert labels.counts.num_distinct > 100


def test_affordance_is_computed_from_all_grasps_even_if_few_are_kept(root):
    for object_id in range(3):
        plenty = refined(root, object_id)
        config = RefineGraspsConfig(
            copies_per_turn=12, num_surface_points=1024, max_grasps=50, max_copies=50
        )
        scarce = refined(root, object_id, config)
        assert scarce.counts.num_originals == 50
        assert_allclose(scarce.affordance, plenty.affordance)


def test_affordance_follows_from_the_contact_pairs(root):
    labels, radius = affordance_labels.read(root.affordance_path(1)), CONFIG.contact_radius
    spread = point_affordance(labels.points, labels.contacts, labels.quality, radius)
    # At half the radius, one kept grasp represents all grasps at its place.
    wider = point_affordance(labels.points, labels.contacts, labels.quality, 0.5 * radius)
    assert (labels.affordance <= spread + 1e-6).mean() > 0.99
    assert (labels.affordance >= wider - 1e-6).mean() > 0.99


def shape(made):
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


X, Y, Z = np.eye(3)
ORIGIN = np.zeros(3)
# Meshes that are symmetric to the last triangle, and their symmetries.
EXACT = {
    "box": (
        shape(trimesh.creation.box((0.06, 0.04, 0.08))),
        tuple(ReflectionSymmetry(normal, ORIGIN) for normal in (X, Y, Z)),
    ),
    "cylinder": (
        shape(trimesh.creation.cylinder(0.03, 0.08, sections=72)),
        (RotationSymmetry(Z, ORIGIN), ReflectionSymmetry(Z, ORIGIN)),
    ),
    "six sides": (
        shape(trimesh.creation.cylinder(0.03, 0.08, sections=6)),
        (RotationSymmetry(Z, ORIGIN, order=6), ReflectionSymmetry(Y, ORIGIN)),
    ),
}
seeds = st.integers(0, 2**32 - 1)


def held_grasps(mesh, rng, count=60):
    """Random grasps that hold on `mesh`, between exact contacts, with their exact quality."""
    rotation = np.stack([random_rotation(rng) for _ in range(count)])
    opened = GraspPoses(rotation, rng.uniform(-0.02, 0.02, (count, 3)), np.full(count, 0.14))
    contacts = close_fingers(mesh, opened, opened.width)
    friction = min_friction(contacts)
    held = friction <= 1.0
    grasps = GraspPoses.from_contacts(contacts.points[held], opened.approach[held])
    return RatedGrasps(grasps, 1.0 - friction[held])


def copied(mesh, rated, symmetries, config):
    rng = np.random.default_rng(0)
    surface = Surface.from_mesh(mesh, 8000, rng)
    labels = ObjectSymmetries("x", symmetries)
    return Copier(mesh, surface, labels, config).with_copies(rated, rng)


@settings(max_examples=12, deadline=None)
@given(seeds, st.sampled_from(sorted(EXACT)))
def test_copies_need_the_friction_of_their_originals_on_a_symmetric_mesh(seed, name):
    mesh, symmetries = EXACT[name]
    rated = held_grasps(mesh, np.random.default_rng(seed))
    both, dropped = copied(mesh, rated, symmetries, CONFIG)
    assert dropped == 0
    grasps = both.grasps
    again = min_friction(close_fingers(mesh, grasps, grasps.width + 0.002))
    # A contact within a hair of an edge may fall on either of its faces.
    same = np.isclose(1.0 - again, both.quality, atol=1e-4)
    assert same.mean() > 0.98


@settings(max_examples=12, deadline=None)
@given(seeds, st.sampled_from(sorted(EXACT)))
def test_validation_keeps_the_copies_on_a_symmetric_mesh(seed, name):
    mesh, symmetries = EXACT[name]
    rated = held_grasps(mesh, np.random.default_rng(seed))
    validate = RefineGraspsConfig(copies_per_turn=12, validate_copies=True)
    plain, _ = copied(mesh, rated, symmetries, CONFIG)
    checked, dropped = copied(mesh, rated, symmetries, validate)
    assert dropped <= 0.02 * len(plain)
    assert len(checked) == len(plain) - dropped
    # Quality on the labels' grid: at most 0.1 lower, never higher.
    own = checked.quality[len(rated) :]
    assert np.isin((own * 10).round(6), np.arange(10)).all()


def test_validation_drops_copies_where_a_symmetry_is_wrong():
    ball, box = trimesh.creation.icosphere(3, 0.03), trimesh.creation.box((0.03, 0.03, 0.03))
    box.apply_translation((0.0, 0.0, 0.045))
    mesh = shape(trimesh.util.concatenate([ball, box]))
    rated = held_grasps(mesh, np.random.default_rng(0), 300)
    kept = {}
    for validate in (False, True):
        config = RefineGraspsConfig(copies_per_turn=12, validate_copies=validate)
        both, dropped = copied(mesh, rated, (SphereSymmetry(ORIGIN),), config)
        assert dropped > 0
        kept[validate] = both
    grasps = kept[True].grasps[np.arange(len(rated), len(kept[True]))]
    contacts = close_fingers(mesh, grasps, grasps.width + 1e-4)
    assert_allclose(contacts.points, grasps.contacts, atol=1e-6)
    assert len(kept[True]) < len(kept[False])


def test_a_regions_symmetry_copies_only_grasps_of_that_region():
    ball, box = trimesh.creation.icosphere(3, 0.03), trimesh.creation.box((0.03, 0.03, 0.03))
    box.apply_translation((0.0, 0.0, 0.1))
    mesh = shape(trimesh.util.concatenate([ball, box]))
    triangles = np.flatnonzero(mesh.triangles[:, :, 2].max(axis=1) < 0.05)
    labels = ObjectSymmetries(
        "x", (), (ObjectRegion("ball", triangles, (SphereSymmetry(ORIGIN),)),)
    )
    rng = np.random.default_rng(0)
    surface = Surface.from_mesh(mesh, 8000, rng)
    on_ball = held_grasps(mesh, rng, 40)
    lifted = GraspPoses(np.eye(3)[None], np.array([[0.0, 0.0, 0.1]]), np.array([0.03]))
    across = GraspPoses.from_contacts([[[0.0, 0.0, -0.03], [0.0, 0.0, 0.115]]], [[1.0, 0.0, 0.0]])
    others = RatedGrasps(GraspPoses.concatenate([lifted, across]), np.array([0.5, 0.4]))
    rated = RatedGrasps.concatenate([others, on_ball])
    copier = Copier(mesh, surface, labels, CONFIG)
    both, _ = copier.with_copies(rated, rng)
    copies = both[np.arange(len(rated), len(both))]
    assert len(copies) > 20 * len(on_ball)
    assert not np.isin(copies.quality, [0.5, 0.4]).any()
    assert_allclose(np.linalg.norm(copies.grasps.contacts, axis=-1), 0.03, atol=1e-3)


def test_a_round_region_is_copied_about_the_axis_of_an_object_with_discrete_turns():
    mesh, rng = shape(trimesh.creation.icosphere(3, 0.03)), np.random.default_rng(0)
    region = ObjectRegion("r", np.arange(len(mesh.faces)), (RotationSymmetry(Z, ORIGIN),))
    labels = ObjectSymmetries("x", (RotationSymmetry(Z, ORIGIN, order=4),), (region,))
    copier = Copier(mesh, Surface.from_mesh(mesh, 8000, rng), labels, CONFIG)
    level = GraspPoses.from_contacts([[[-0.0299, 0.0, 0.0], [0.0299, 0.0, 0.0]]], [Z])
    both, _ = copier.with_copies(RatedGrasps(level, np.array([0.9])), rng)
    assert len(both) > 4


def test_grasps_with_a_finger_off_the_region_are_not_copied_where_the_copies_would_hold():
    box = trimesh.creation.box((0.06, 0.04, 0.08)).subdivide().subdivide().subdivide()
    mesh, rng = shape(box), np.random.default_rng(0)
    upper = np.flatnonzero(mesh.triangles[:, :, 2].min(axis=1) >= 0.0)
    region = ObjectRegion("upper", upper, (ReflectionSymmetry(X, ORIGIN),))
    labels, surface = ObjectSymmetries("x", (), (region,)), Surface.from_mesh(mesh, 8000, rng)
    high = [[0.02, -0.02, 0.03], [0.02, 0.02, 0.03]]
    low = [[0.02, -0.02, -0.03], [0.02, 0.02, -0.03]]
    across = [[0.02, 0.0, -0.04], [0.02, 0.0, 0.04]]
    grasps = GraspPoses.from_contacts([high, low, across], np.tile(X, (3, 1)))
    copier = Copier(mesh, surface, labels, CONFIG)
    both, dropped = copier.with_copies(RatedGrasps(grasps, np.array([0.7, 0.8, 0.9])), rng)
    assert dropped == 0
    assert_allclose(both.quality, [0.7, 0.8, 0.9, 0.7])
    assert_allclose(both.grasps.translation[3], [-0.02, 0.0, 0.03], atol=1e-9)
    mirrored = np.array([[-0.02, 0.02, 0.03], [-0.02, 0.02, -0.03], [-0.02, 0.0, -0.04]])
    before, after = copier.affordance(mirrored, RatedGrasps(grasps, np.array([0.7, 0.8, 0.9])))
    assert_allclose(before, 0.0)
    assert_allclose(after, [0.7, 0.0, 0.0])


def damaged(root, tmp_path, damages):
    """A root with one object for each damage after the sound objects 0 to 2, and its report."""
    other = GraspNetRoot(shutil.copytree(root.root, tmp_path / "copy"))
    shutil.rmtree(other.affordance_path(0).parent)
    for number, damage in enumerate(damages, start=10):
        shutil.copytree(other.model_path(0).parent, other.model_path(number).parent)
        shutil.copy(other.symmetry_path(0), other.symmetry_path(number))
        damage(other.grasp_label_path(0), other.grasp_label_path(number))
    return refine_grasps.run(other.root, CONFIG, options=QUIET)


def test_bad_labels_give_one_sentence_each_and_the_rest_is_done(root, tmp_path):
    def changed(**arrays):
        def damage(good, bad):
            with np.load(good) as content:
                merged = {name: content[name] for name in content.files} | arrays
            kept = {name: array for name, array in merged.items() if array is not None}
            np.savez_compressed(bad, allow_pickle=True, **kept)

        return damage

    def cut(good, bad):
        bad.write_bytes(good.read_bytes()[:-200])

    huge = np.broadcast_to(np.float32(0), (400, 300, 12, 4))  # 23 MB of zeros
    report = damaged(
        root,
        tmp_path,
        [
            changed(scores=None),
            changed(collision=np.zeros((2, 3), bool)),
            cut,
            changed(scores=huge),
            changed(points=np.array([[None, 0, 0]] * 2, object)),
        ],
    )
    assert report.done == ["000", "001", "002"]
    assert report.exit_code == 1
    words = ["lacks", "collision of shape", "whole", "scores of shape", "pickles"]
    for sentence, word in zip(report.failed.values(), words, strict=True):
        assert word in sentence
        assert "_labels.npz" in sentence
        assert "\n" not in sentence
