"""Objects are dropped, kept and viewed by their middle, wherever their origin is."""

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.errors import SymgraspError
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.transforms import transform_points
from pipelines.synthesis.objects.decomposition import hull_of_points
from pipelines.synthesis.objects.pools import make_object
from pipelines.synthesis.scenes.settling import drop_objects, refuse_bodiless
from pipelines.synthesis.scenes.surroundings import drawn_container
from pipelines.synthesis.scenes.tables import TABLE_SIZE, SceneObject, settle
from tests.metrics.shapes import box

SEEDS = range(12)
SHEET = Mesh(np.array([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]]), [[0, 1, 2], [0, 2, 3]])


def shifted(offset, *, number=0):
    """A standing box whose origin is `offset` metres away from its middle."""
    solid = box(0.06, 0.08, 0.1)
    mesh = Mesh(solid.vertices + np.asarray(offset, float), solid.faces)
    return SceneObject(number, f"{number:03d}", mesh, (hull_of_points(mesh.vertices),))


def kept(item, seed):
    settled = drop_objects([item.pieces], np.random.default_rng(seed), item.center[None])
    return len(settled.index)


@pytest.mark.parametrize("offset", [(0.5, 0.0, 0.0), (0.0, 0.4, 0.3), (0.0, 0.0, 0.09)])
def test_objects_with_a_distant_origin_are_not_lost(offset):
    centered, moved = shifted((0, 0, 0)), shifted(offset)
    assert_allclose(moved.center, offset)
    expected = [kept(centered, seed) for seed in SEEDS]
    assert [kept(moved, seed) for seed in SEEDS] == expected
    assert sum(expected) >= 11


def test_cameras_aim_at_the_objects_and_not_at_their_origins():
    offsets = [(0.5, 0, 0), (0, 0.4, 0.1), (0.3, 0.3, 0)]
    items = [shifted(offset, number=i) for i, offset in enumerate(offsets)]
    for seed in SEEDS:
        layout = settle(items, np.random.default_rng(seed))
        clouds = [
            item.mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
            for item, pose in zip(layout.objects, layout.poses, strict=True)
        ]
        middles = np.array([(c.min(axis=0) + c.max(axis=0)) / 2 for c in clouds])
        assert_allclose(layout.middles, middles, atol=1e-9)
        assert_allclose(layout.center, middles.mean(axis=0), atol=1e-9)
        assert (np.linalg.norm(middles[:, :2], axis=1) < 0.3).all()
        assert (np.abs(middles[:, :2]) < TABLE_SIZE).all()


@pytest.mark.parametrize("pool", ["seen", "similar", "novel"])
def test_the_origin_of_procedural_objects_is_their_middle_to_the_last_bit(pool):
    items = [
        SceneObject(i, made.name, made.mesh, made.pieces)
        for i, made in enumerate(make_object(pool, index, 3) for index in range(24))
    ]
    assert all((item.center == 0.0).all() for item in items)
    pieces = [item.pieces for item in items[:4]]
    by_origin = drop_objects(pieces, np.random.default_rng(1))
    layout = settle(items[:4], np.random.default_rng(1))
    assert_array_equal(layout.poses, by_origin.poses)
    assert_array_equal(layout.center, by_origin.poses[:, :3, 3].mean(axis=0))


@pytest.mark.parametrize("kind", ["bin", "tray"])
def test_flat_objects_do_not_sink_into_the_floor_of_a_container(kind):
    plate = box(0.1, 0.08, 0.006)
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        container = drawn_container(kind, rng)
        settled = drop_objects([(plate,)] * 3, rng, container=container)
        assert len(settled.index)
        lowest = min(transform_points(pose, plate.vertices)[:, 2].min() for pose in settled.poses)
        assert lowest > container.floor - 0.001


def test_meshes_without_volume_are_reported_in_one_sentence():
    for mesh in (SHEET, Mesh(1e-6 * SHEET.vertices, SHEET.faces)):
        with pytest.raises(SymgraspError, match="make no solid body"):
            refuse_bodiless([mesh])
        with pytest.raises(SymgraspError, match="make no solid body"):
            drop_objects([[mesh]], np.random.default_rng(0))
    refuse_bodiless([box(0.05, 0.05, 0.05)])


def test_points_that_span_no_volume_have_no_hull():
    with pytest.raises(SymgraspError, match="3 corners of a mesh span no volume"):
        hull_of_points(np.eye(3))
    solid = trimesh.creation.box((0.1, 0.1, 0.1))
    assert hull_of_points(solid.vertices).volume == pytest.approx(1e-3)
    hull_of_points(SHEET.vertices)  # a sheet has one without volume, and no warning
