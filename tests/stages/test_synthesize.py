"""Stage synthesize: a small, complete, resumable root in GraspNet's layout."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose

from pipelines import synthesize
from pipelines.configs import EvaluateConfig, LabelConfig, SceneryConfig, SynthesizeConfig
from pipelines.dataset import object_list
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_label_stream import read_grasp_label
from pipelines.dataset.graspnet.graspnet_labels import read_collision_labels, read_rect
from pipelines.dataset.graspnet.signed_distance import read_sdf
from pipelines.dataset.meshes import read_mesh, write_mesh
from pipelines.errors import SymgraspError
from pipelines.evaluation.truth import TruthReader
from pipelines.frames.frames import find_frames
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.transforms import transform_points
from pipelines.mesh_symmetry.surface.sampled_surface import Surface
from pipelines.runtime.batch import BatchOptions
from pipelines.storage.provenance import read_stamp

QUIET = BatchOptions(progress=False)
CONFIG = SynthesizeConfig(
    splits=("train", "novel"),
    scenes_per_split=1,
    views=2,
    objects_per_pool=3,
    min_objects=2,
    max_objects=3,
    width=160,
    height=120,
    labels=LabelConfig(num_points=2),
)


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    folder = tmp_path_factory.mktemp("root")
    report = synthesize.run(folder, CONFIG, QUIET, seed=4)
    assert report.failed == {}
    return folder


def test_the_root_loads_in_the_graspnet_reader(root):
    reader = GraspNetRoot(root)
    assert reader.object_ids() == [0, 1, 2, 6, 7, 8]
    assert reader.scene_ids() == [0, 160]
    scene = reader.scene(160, "realsense")
    assert set(scene.object_ids) <= {6, 7, 8}
    assert len(scene.frame_ids) == 2
    assert scene.camera_poses.shape == (2, 4, 4)
    assert_allclose(scene.camera_poses[0], np.eye(4), atol=1e-9)


def test_poses_masks_and_depth_agree(root):
    reader = GraspNetRoot(root)
    for frame in reader.scene(0, "realsense").frames():
        recorded, label = reader.read_frame(frame), reader.read_label(frame)
        cloud = recorded.intrinsics.backproject(recorded.depth)
        for pose in reader.read_annotation(frame):
            mine = cloud[(label == pose.object_id + 1) & (recorded.depth > 0)]
            if len(mine) < 50:
                continue
            mesh = read_mesh(reader.model_path(pose.object_id))
            local = transform_points(np.linalg.inv(pose.T_cam_obj), mine)
            surface = Surface.from_mesh(mesh, 5000, np.random.default_rng(0))
            assert np.median(surface.distances(local)[0]) < 0.004


def test_the_table_is_level_in_the_table_frame(root):
    reader = GraspNetRoot(root)
    scene = reader.scene(0, "realsense")
    for frame in scene.frames():
        recorded, label = reader.read_frame(frame), reader.read_label(frame)
        T_table_cam = scene.cam0_wrt_table @ scene.camera_poses[frame.frame_id]
        cloud = recorded.intrinsics.backproject(recorded.depth)[(label == 0) & (recorded.depth > 0)]
        heights = transform_points(T_table_cam, cloud)[:, 2]
        assert np.median(np.abs(heights[np.abs(heights) < 0.1])) < 0.004


def test_frames_are_found_by_the_inference_reader(root):
    frames = find_frames(root)
    assert len(frames) == 4
    assert frames[0].read().depth.shape == (120, 160)


def test_labels_and_collisions_have_graspnets_shapes(root):
    reader = GraspNetRoot(root)
    label = read_grasp_label(reader.grasp_label_path(0))
    assert label.offsets.shape == (2, 300, 12, 4, 3)
    collisions = read_collision_labels(reader.collision_label_path(0))
    assert len(collisions) == len(reader.scene(0, "realsense").object_ids)
    assert all(array.shape == (2, 300, 12, 4) for array in collisions)
    for frame in reader.scene(0, "realsense").frames():
        assert set(read_rect(frame.path("rect"))[:, 6]) <= {0.0, 1.0, 2.0}


def test_the_list_of_objects_names_families_and_pools(root):
    records = object_list.read(root / "objects.json")
    assert [r.pool for r in records] == ["seen"] * 3 + ["novel"] * 3
    assert all(r.family for r in records)


def test_a_second_run_redoes_nothing_and_a_lost_scene_comes_back_the_same(root):
    again = synthesize.run(root, CONFIG, QUIET, seed=4)
    assert again.done == []
    color = root / "scenes/scene_0160/realsense/rgb/0001.png"
    depth = root / "scenes/scene_0160/realsense/depth/0001.png"
    before = color.read_bytes(), depth.read_bytes()
    shutil.rmtree(root / "scenes/scene_0160")
    assert synthesize.run(root, CONFIG, QUIET, seed=4).done == ["scene 0160"]
    assert (color.read_bytes(), depth.read_bytes()) == before


@pytest.mark.parametrize(
    "name",
    [
        "scenes/scene_0160/object_id_list.txt",
        "scenes/scene_0160/rs_wrt_kn.npy",
        "scenes/scene_0160/realsense/rect/0001.npy",
        "scenes/scene_0160/realsense/camK.npy",
        "scenes/scene_0160/realsense/meta/0001.mat",
        "collision_label/scene_0160/collision_labels.npz",
    ],
)
def test_a_scene_that_has_lost_a_file_is_made_again(root, name):
    before = (root / name).read_bytes()
    (root / name).unlink()
    assert synthesize.run(root, CONFIG, QUIET, seed=4).done == ["scene 0160"]
    assert (root / name).read_bytes() == before


def test_surroundings_are_written_with_the_scene_and_read_as_obstacles(tmp_path):
    scenery = SceneryConfig(surroundings=("bin",), robot_hands=0.5)
    config = replace(CONFIG, splits=("train",), scenery=scenery)
    assert synthesize.run(tmp_path, config, QUIET, seed=4).failed == {}
    walls = GraspNetRoot(tmp_path).scene(0).surroundings
    assert len(walls) >= 5
    assert all(wall.is_watertight for wall in walls)
    read = TruthReader(GraspNetRoot(tmp_path), EvaluateConfig())
    _, obstacles = read._camera_and_surroundings(GraspNetRoot(tmp_path).scene(0))
    assert len(obstacles) == len(walls)


def test_a_plain_scene_has_no_surroundings_and_its_stamp_no_scenery(root):
    scene = GraspNetRoot(root).scene(0)
    assert scene.surroundings == []
    assert not scene.surroundings_path.exists()
    assert "scenery" not in read_stamp(scene.folder)["config"]


@pytest.mark.parametrize(("kinds", "is_marked"), [(("plain", "tray"), True), (("wall",), False)])
def test_scenes_of_containers_that_objects_sank_into_are_no_longer_finished(
    tmp_path, kinds, is_marked
):
    scenery = SceneryConfig(surroundings=kinds)
    labels = LabelConfig(num_points=0)
    config = replace(CONFIG, splits=("train",), views=1, labels=labels, scenery=scenery)
    assert synthesize.run(tmp_path, config, QUIET, seed=4).failed == {}
    stamp = tmp_path / "scenes/scene_0000/provenance.json"
    content = json.loads(stamp.read_text())
    assert (content["config"].pop("container_floors", None) is not None) == is_marked
    stamp.write_text(json.dumps(content))
    again = synthesize.run(tmp_path, config, QUIET, seed=4)
    assert set(again.failed) == ({"scene 0000"} if is_marked else set())


def test_other_settings_are_refused(root):
    report = synthesize.run(root, replace(CONFIG, views=3), QUIET, seed=4)
    assert set(report.failed) == {"scene 0000", "scene 0160"}
    assert report.exit_code == 1


def test_objects_that_a_scene_of_an_earlier_run_shows_are_not_replaced(root):
    before = read_stamp(root / "models/000")
    seen = replace(CONFIG, splits=("seen",))
    with pytest.raises(SymgraspError, match=r"scene_0000 shows object 00\d, which would be"):
        synthesize.run(root, seen, replace(QUIET, overwrite=True), seed=5)
    assert read_stamp(root / "models/000") == before
    assert synthesize.run(root, CONFIG, QUIET, seed=4).done == []


def test_a_scene_made_again_without_collision_labels_has_no_earlier_ones(root, tmp_path):
    shutil.copytree(root, tmp_path / "root")
    config = replace(CONFIG, splits=("train",), views=1, collision_labels=False)
    options = replace(QUIET, overwrite=True)
    assert synthesize.run(tmp_path / "root", config, options, seed=4).failed == {}
    labels = GraspNetRoot(tmp_path / "root").collision_label_path
    assert list(labels(160).parent.iterdir())
    assert not list(labels(0).parent.iterdir())


def test_the_users_meshes_are_used(tmp_path):
    for name, size in (("a", (0.05, 0.06, 0.1)), ("b", (0.04, 0.04, 0.12))):
        trimesh.creation.box(size).export(tmp_path / f"{name}.stl")
    config = replace(CONFIG, splits=("train",), labels=LabelConfig(num_points=0))
    report = synthesize.run(tmp_path / "root", config, QUIET, models=tmp_path)
    assert report.failed == {}
    assert GraspNetRoot(tmp_path / "root").object_ids() == [0, 1]
    assert report.notes["objects"].startswith(f"all meshes of {tmp_path} are used; --objects")


def test_the_models_of_a_dataset_are_used_and_a_dataset_without_models_is_refused(tmp_path):
    own = GraspNetRoot(tmp_path / "own")
    for object_id in (2, 5):
        box = trimesh.creation.box((0.05, 0.06, 0.1))
        write_mesh(own.model_path(object_id), Mesh(np.array(box.vertices), np.array(box.faces)))
    config = replace(CONFIG, splits=("train",), labels=LabelConfig(num_points=0))
    for number, source in enumerate((own.root, own.root / "models")):
        made = GraspNetRoot(tmp_path / f"root{number}")
        assert synthesize.run(made.root, config, QUIET, models=source).failed == {}
        records = object_list.read(made.root / "objects.json")
        assert [(each.object_id, each.name) for each in records] == [(0, "002"), (1, "005")]
    own.model_path(2).unlink()
    report = synthesize.run(tmp_path / "torn", config, QUIET, models=own.root)
    assert list(report.failed) == ["object 000"]
    assert "nontextured.ply does not exist" in report.failed["object 000"]
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "._a.ply").write_bytes(b"Mac OS X")
    for source, sentence in (("empty", "holds no meshes"), ("nowhere", "does not exist")):
        with pytest.raises(SymgraspError, match=sentence):
            synthesize.run(tmp_path / "none", config, QUIET, models=tmp_path / source)
    assert not (tmp_path / "none").exists()


def test_meshes_in_millimetres_are_refused_or_scaled(tmp_path):
    for name in "ab":
        trimesh.creation.box((50.0, 60.0, 100.0)).export(tmp_path / f"{name}.stl")
    config = replace(CONFIG, splits=("train",), labels=LabelConfig(num_points=0))
    report = synthesize.run(tmp_path / "root", config, QUIET, models=tmp_path)
    assert set(report.failed) == {"object 000", "object 001"}
    assert "--mesh-scale 0.001" in report.failed["object 000"]
    assert "once all objects" in report.notes["scenes"]
    report = synthesize.run(tmp_path / "root", config, QUIET, models=tmp_path, mesh_scale=0.001)
    assert report.failed == {}
    diagonal = read_mesh(GraspNetRoot(tmp_path / "root").model_path(0)).diagonal
    assert diagonal == pytest.approx(np.linalg.norm([0.05, 0.06, 0.1]), rel=1e-5)


def test_distance_grids_are_added_to_a_finished_root(tmp_path):
    trimesh.creation.box((0.05, 0.06, 0.1)).export(tmp_path / "a.stl")
    small = {"splits": ("train",), "min_objects": 1, "labels": LabelConfig(num_points=0)}
    config, root = replace(CONFIG, **small), tmp_path / "root"
    assert synthesize.run(root, config, QUIET, models=tmp_path).failed == {}
    again = synthesize.run(root, config, QUIET, models=tmp_path, sdf=True)
    assert (again.done, again.failed) == (["distance grid 000"], {})
    grid = read_sdf(root / "models/000/textured.sdf")
    assert (grid.values < 0).sum() * grid.spacing**3 == pytest.approx(0.05 * 0.06 * 0.1, rel=0.05)
    assert synthesize.run(root, config, QUIET, models=tmp_path, sdf=True).done == []


@pytest.mark.parametrize("name", ["nontextured.ply", "textured.obj", "convex.npz"])
def test_a_lost_model_is_made_again(tmp_path, name):
    trimesh.creation.box((0.05, 0.06, 0.1)).export(tmp_path / "a.stl")
    small = {"splits": ("train",), "min_objects": 1, "labels": LabelConfig(num_points=0)}
    config, root = replace(CONFIG, **small), tmp_path / "root"
    synthesize.run(root, config, QUIET, models=tmp_path)
    model = root / "models" / "000" / name
    before = model.read_bytes()
    model.unlink()
    assert synthesize.run(root, config, QUIET, models=tmp_path).done == ["object 000"]
    assert model.read_bytes() == before


@pytest.mark.parametrize(
    "change",
    [
        {"splits": ("dev",)},
        {"scenes_per_split": 1001},
        {"objects_per_pool": 4000},
        {"sensor": "x"},
        {"min_objects": 10},  # more than max_objects
    ],
)
def test_impossible_settings_are_refused_before_anything_is_written(tmp_path, change):
    with pytest.raises(SymgraspError):
        synthesize.run(tmp_path / "root", replace(CONFIG, **change), QUIET)
    assert not (tmp_path / "root").exists()
