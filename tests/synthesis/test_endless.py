"""Endless regions: repeatable, with true labels, of objects and seeds of no evaluation."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipelines.configs import EndlessConfig, PackConfig
from pipelines.dataset import object_list
from pipelines.dataset.object_list import ObjectRecord
from pipelines.errors import MissingInputError, SymgraspError
from pipelines.frames.graspnet_scene import write_object_ids
from pipelines.geometry.rendering import Scene, cast_view
from pipelines.geometry.transforms import invert, make_pose
from pipelines.synthesis.endless import (
    EndlessScenes,
    read_object,
    scene_generator,
    trainable_objects,
    window_of,
)
from pipelines.synthesis.scenes.cameras import look_at, sensor_intrinsics
from tests.stages.toy_root import SHAPES, STAMP, write_root

CONFIG = EndlessConfig(
    views=2, regions_per_scene=6, width=320, height=240, max_objects=4,
    pack=PackConfig(num_points=256, min_pixels=100),
)  # fmt: skip
EXACT = replace(CONFIG, perfect_share=1.0, pack=replace(CONFIG.pack, mask_noise=False))
POOLS = {0: "seen", 1: "seen", 2: "novel"}


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    made = write_root(tmp_path_factory.mktemp("root"))
    records = [ObjectRecord(i, f"object{i}", "toy", pool) for i, pool in POOLS.items()]
    object_list.write(made.root / "objects.json", records, STAMP)
    return made


@pytest.fixture(scope="module")
def scenes(root):
    return EndlessScenes.of_roots([root.root], CONFIG, 0)


def test_a_scene_is_the_same_whenever_it_is_drawn(root, scenes):
    first, again = scenes.regions(3), EndlessScenes.of_roots([root.root], CONFIG, 0).regions(3)
    assert len(first) == CONFIG.regions_per_scene
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.points, other.points)
        np.testing.assert_array_equal(one.affordance, other.affordance)
    other_scene, other_seed = (
        scenes.regions(4),
        EndlessScenes.of_roots([root.root], CONFIG, 1).regions(3),
    )
    assert not np.array_equal(first[0].points, other_scene[0].points)
    assert not np.array_equal(first[0].points, other_seed[0].points)


def test_all_regions_of_a_scene_are_used_before_one_is_repeated(root):
    scenes = EndlessScenes.of_roots([root.root], replace(CONFIG, regions_per_scene=7), 0)
    for number in range(4):
        regions = scenes.regions(number)
        times = Counter(region.points.tobytes() for region in regions)
        assert len(regions) == 7
        assert max(times.values()) - min(times.values()) <= 1


def test_scenes_without_a_region_are_drawn_again_however_few_regions_are_wanted(root, monkeypatch):
    scenes = EndlessScenes.of_roots([root.root], replace(CONFIG, regions_per_scene=1), 0)
    drawn, draw = [], EndlessScenes._drawn_clouds

    def empty_at_first(self, rng):
        drawn.append(draw(self, rng) if drawn else [])
        return drawn[-1]

    monkeypatch.setattr(EndlessScenes, "_drawn_clouds", empty_at_first)
    assert len(scenes.regions(3)) == 1
    assert len(drawn) > 1


def test_objects_that_an_evaluation_keeps_unseen_are_never_shown(root, scenes):
    assert trainable_objects(root) == [0, 1]
    assert {region.object_id for n in range(4) for region in scenes.regions(n)} == {0, 1}


def test_objects_of_several_roots_are_shown_together(root, scenes):
    both = EndlessScenes.of_roots([root.root, root.root], CONFIG, 0)
    assert list(both.objects) == [0, 1, 2, 3]  # the trainable objects 0 and 1 of either root
    for number, regioned in both.regioned.items():
        same = scenes.objects[number % 2]
        assert both.objects[number].scene.object_id == number
        np.testing.assert_array_equal(regioned.mesh.vertices, same.regioned.mesh.vertices)
    assert {region.object_id for n in range(6) for region in both.regions(n)} == {0, 1, 2, 3}


def test_without_a_list_only_objects_of_train_scenes_are_shown(tmp_path):
    bare = write_root(tmp_path)  # its scenes are of the splits seen and novel
    with pytest.raises(SymgraspError, match="no objects to train on"):
        trainable_objects(bare)
    (bare.scene_folder(7) / "kinect").mkdir(parents=True)
    write_object_ids(bare.scene_folder(7) / "object_id_list.txt", [2, 1])
    assert trainable_objects(bare) == [1, 2]


def test_a_train_scene_without_cameras_is_named(tmp_path, caplog):
    bare = write_root(tmp_path)
    for scene_id in (7, 8):
        write_object_ids(bare.scene_folder(scene_id) / "object_id_list.txt", [scene_id])
    (bare.scene_folder(7) / "kinect").mkdir()
    assert trainable_objects(bare) == trainable_objects(bare) == [7]
    assert caplog.messages == [
        f"{bare.scene_folder(8)} has no folder kinect or realsense, so it is left out"
    ]


@given(st.integers(0, 2**31), st.integers(0, 2**31), st.integers(0, 5), st.integers(0, 10**6))
def test_generators_never_equal_those_of_a_dataset(seed, other, tag, scene):
    """For all seeds: `synthesize` and `pack` draw from lists [seed, tag, number]."""
    ours = scene_generator(seed, scene).bit_generator.state["state"]
    for number in (scene, scene % 190, seed):
        for words in ([seed, tag, number], [other, tag, number], [other, number], [seed, number]):
            assert np.random.default_rng(words).bit_generator.state["state"] != ours


def test_points_and_symmetries_are_of_the_same_object(root):
    for region in EndlessScenes.of_roots([root.root], EXACT, 5).regions(0):
        center = np.nanmean(region.point, axis=0)
        away = region.points - center
        assert np.abs(away).max() < 0.08  # the box's half diagonal and sensor-free points
        if region.existence[3]:  # the can's axis: its wall and lids are within its radius
            across = away - np.outer(away @ region.direction[3], region.direction[3])
            assert np.linalg.norm(across, axis=1).max() < 0.027
        else:
            normals = region.direction[:3]
            np.testing.assert_allclose(normals @ normals.T, np.eye(3), atol=1e-6)
            assert np.abs(away @ normals[0]).max() < 0.032
        assert set(np.unique(region.affordance)) <= {0.0, 1.0}


def test_mask_errors_add_points_of_other_objects_and_lose_own_ones(root):
    def strays(config):
        drawn = EndlessScenes.of_roots([root.root], config, 2)
        regions = [region for n in range(5) for region in drawn.regions(n)]
        away = [np.linalg.norm(r.points - np.nanmean(r.point, axis=0), axis=1) for r in regions]
        return np.mean(np.concatenate(away) > 0.075)

    noisy = replace(CONFIG, perfect_share=1.0, mask_leaks=1.0)
    assert strays(EXACT) == 0.0
    assert strays(noisy) > 0.01


def test_a_hand_in_front_of_the_objects_hides_some_of_them(root):
    def shown(occluders):
        drawn = EndlessScenes.of_roots([root.root], replace(EXACT, occluders=occluders, views=4), 3)
        clouds = [drawn._drawn_clouds(np.random.default_rng(seed)) for seed in range(6)]
        return sum(len(each) for each in clouds)

    assert shown(1.0) < shown(0.0)


def test_the_window_equals_its_part_of_the_whole_image(root):
    mesh = read_object(root, 0).scene.mesh
    lens = sensor_intrinsics("kinect", 320, 240)
    T_world_cam = look_at([0.3, 0.2, 0.5], [0.0, 0.0, 0.0])
    pose = make_pose(np.eye(3), [0.02, 0.0, 0.05])
    window = window_of(lens, [mesh], (invert(T_world_cam) @ pose)[None])
    assert window.width < 160
    whole = cast_view(Scene([mesh], [pose]), lens, T_world_cam).depth
    part = cast_view(Scene([mesh], [pose]), window, T_world_cam).depth
    row, column = round(lens.cy - window.cy), round(lens.cx - window.cx)
    rows, columns = slice(row, row + window.height), slice(column, column + window.width)
    np.testing.assert_allclose(part, whole[rows, columns], atol=1e-9)
    assert (part > 0).sum() == (whole > 0).sum()


def test_labels_that_are_missing_are_named(tmp_path):
    bare = write_root(tmp_path)
    bare.affordance_path(1).unlink()
    with pytest.raises(MissingInputError, match="refine-grasps"):
        read_object(bare, 1)
    assert set(SHAPES) == {0, 1, 2}
