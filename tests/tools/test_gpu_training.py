"""Objects that travel to a GPU keep their labels; regions there are those of `symgrasp train`."""

import numpy as np
import pytest
import torch
from scipy.spatial import KDTree

from pipelines.configs import EndlessConfig, NetworkConfig, PackConfig, TrainConfig
from pipelines.dataset import object_list
from pipelines.dataset.object_list import ObjectRecord
from pipelines.learning.loop.loaders import draw_points
from pipelines.synthesis.endless import EndlessScenes
from tests.stages.toy_root import STAMP, write_root
from tools.gpu_training import labelled_objects, rendering, train

FEW = EndlessConfig(
    views=1, regions_per_scene=4, width=320, height=240, min_objects=2, max_objects=2
)
CONFIG = TrainConfig(network=NetworkConfig(num_points=rendering.POINTS))
CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def objects(tmp_path_factory):
    made = write_root(tmp_path_factory.mktemp("root"))
    records = [ObjectRecord(i, f"object{i}", "toy", "seen") for i in range(3)]
    object_list.write(made.root / "objects.json", records, STAMP)
    path = tmp_path_factory.mktemp("packed") / "objects.xz"
    assert labelled_objects.write(path, [made.root]) == 3
    before = EndlessScenes.of_root(made.root, FEW, 0).objects
    return before, labelled_objects.read(path)


def test_meshes_regions_and_symmetries_arrive_as_they_were(objects):
    for before, after in zip(objects[0].values(), objects[1].values(), strict=True):
        size = np.ptp(before.scene.mesh.vertices, axis=0).max()
        mesh = after.regioned.mesh
        np.testing.assert_array_equal(mesh.faces, before.regioned.mesh.faces)
        np.testing.assert_allclose(mesh.vertices, before.regioned.mesh.vertices, atol=2e-5 * size)
        for one, other in zip(before.regioned.regions, after.regioned.regions, strict=True):
            np.testing.assert_array_equal(np.sort(one.triangles), other.triangles)
            assert [type(s) for s in one.symmetries] == [type(s) for s in other.symmetries]
            for a, b in zip(one.symmetries, other.symmetries, strict=True):
                np.testing.assert_array_equal(a.point, b.point)
                np.testing.assert_array_equal(a.direction, b.direction)


def test_the_sample_of_a_surface_covers_all_of_it(objects):
    for before, after in zip(objects[0].values(), objects[1].values(), strict=True):
        points = np.asarray(before.surface.tree.data)
        affordance = after.surface.affordance_at(points, PackConfig().label_radius)
        expected = before.surface.affordance_at(points, PackConfig().label_radius)
        assert np.abs(affordance - expected).mean() < 0.05


def test_a_region_in_the_ring_is_the_one_that_train_would_draw(objects):
    region = EndlessScenes(objects[1], FEW, 1).regions(0)[0]
    ring = rendering.RegionRing(3, CPU)
    for _ in range(4):  # more than there is room for
        ring.add([np.asarray(each, np.float32)[None] for each in rendering._rows(region)])
    assert len(ring) == 3
    found = ring.batch(torch.tensor([2]), CONFIG, lost_table=0.0)
    points, affordance, existence, center, direction, ground = draw_points(
        region, CONFIG.network, np.random.default_rng(0)
    )
    moved = found.points[0].numpy()
    assert KDTree(points).query(moved)[0].max() < 1e-5
    assert KDTree(moved).query(points)[0].max() < 1e-5
    np.testing.assert_allclose(found.affordance[0].sum(), affordance.sum(), rtol=1e-4)
    exists = existence > 0
    np.testing.assert_array_equal(found.existence[0], existence)
    np.testing.assert_allclose(found.center[0][exists], center[exists], atol=1e-5)
    np.testing.assert_allclose(found.direction[0][exists], direction[exists], atol=1e-5)
    np.testing.assert_allclose(found.ground[0], ground, atol=1e-5)


def test_the_rate_warms_up_and_falls_to_nothing():
    schedule = train.Schedule(rate=1e-3, seconds=100.0, averaged=0.999)
    assert schedule.rate_at(0, 0.0) < 1e-5
    assert schedule.rate_at(train.WARM_UP_STEPS, 0.0) == pytest.approx(1e-3, rel=2e-3)
    assert schedule.rate_at(10_000, 100.0) == pytest.approx(train.SMALLEST_RATE)
