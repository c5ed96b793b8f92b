"""Objects copied to a GPU keep their labels; regions there equal those of `symgrasp train`."""

import argparse
import queue
import threading
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from scipy.spatial import KDTree

from pipelines.configs import (
    DetectorConfig,
    EndlessConfig,
    FinetuneDetectorConfig,
    NetworkConfig,
    PackConfig,
    TrainConfig,
)
from pipelines.dataset import object_list
from pipelines.dataset.object_list import ObjectRecord
from pipelines.dataset.training import detector_frames
from pipelines.dataset.training.detector_frames import DetectorFrame
from pipelines.errors import FormatError, MissingInputError, SymgraspError, ValueRangeError
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.pointcloud import Plane
from pipelines.learning.detector.detector_start import starting_detector
from pipelines.learning.detector.frame_views import random_example
from pipelines.learning.grasp_network.grasp_training import sample_loss
from pipelines.learning.loop.loaders import draw_points
from pipelines.network.detection.detector import MODEL_NAME
from pipelines.network.detection.mask_rcnn import build_detector
from pipelines.network.model import SymmetryGraspNet
from pipelines.network.training import augmentation
from pipelines.network.weights_files import read_weights, weights_metadata
from pipelines.storage.checkpoints import save_weights
from pipelines.synthesis.endless import EndlessScenes
from pipelines.tabletop.depth_channels import SmallFrame
from tests.stages.toy_root import STAMP, write_root
from tools.gpu_training import (
    compare_losses,
    geometry_stream,
    graspnet_frames,
    labelled_objects,
    rendering,
    schedule,
    small_frames,
    train,
    train_detector,
    train_together,
)
from tools.gpu_training.train_detector import DetectorRun

FEW = EndlessConfig(
    views=1, regions_per_scene=4, width=320, height=240, min_objects=2, max_objects=2
)
CONFIG = TrainConfig(network=NetworkConfig(num_points=rendering.POINTS))
CPU = torch.device("cpu")
WEIGHT = "heads.affordance.0.weight"


@pytest.fixture(scope="module")
def objects(tmp_path_factory):
    made = write_root(tmp_path_factory.mktemp("root"))
    records = [ObjectRecord(i, f"object{i}", "toy", "seen") for i in range(3)]
    object_list.write(made.root / "objects.json", records, STAMP)
    path = tmp_path_factory.mktemp("packed") / "objects.xz"
    assert labelled_objects.write(path, [made.root]) == 3
    before = EndlessScenes.of_roots([made.root], FEW, 0).objects
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


def test_a_mesh_may_have_more_vertices_than_sixteen_bits_can_number(objects):
    box, ball = objects[0][0], objects[0][2]
    vertices = np.random.default_rng(0).random((70_000, 3))
    mesh = Mesh(vertices, np.array([[0, 1, 69_999]]))
    big = replace(box, scene=replace(box.scene, mesh=mesh))
    rows = [labelled_objects._rows(each)["faces"] for each in (big, ball)]
    assert rows[0].max() == 69_999
    assert np.concatenate(rows)[0].tolist() == [0, 1, 69_999]


def test_the_sample_of_a_surface_covers_all_of_it(objects):
    for before, after in zip(objects[0].values(), objects[1].values(), strict=True):
        points = np.asarray(before.surface.tree.data)
        affordance = after.surface.affordance_at(points, PackConfig().label_radius)
        expected = before.surface.affordance_at(points, PackConfig().label_radius)
        assert np.abs(affordance - expected).mean() < 0.05


def test_a_region_in_the_ring_equals_the_one_that_train_draws(objects):
    region = EndlessScenes(objects[1], FEW, 1).regions(0)[0]
    ring = rendering.RegionRing(3, CPU)
    for _ in range(4):  # more than the ring can hold
        ring.add([np.asarray(each, np.float32)[None] for each in rendering._rows(region)])
    assert len(ring) == 3
    found = ring.batch(torch.tensor([2]), CONFIG, lost_table=0.0)
    points, affordance, existence, center, direction, ground, camera = draw_points(
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
    np.testing.assert_allclose(found.camera[0], camera, atol=1e-5)


def test_the_points_of_the_ring_come_in_random_order():
    ring, row = rendering.RegionRing(1, CPU), [np.zeros((1, *each)) for each in rendering.SHAPES]
    row[0][0] = np.linspace(0.0, 1.0, rendering.POINTS)[:, None]
    row[5][0] = np.eye(3)
    ring.add(row)
    x = ring.batch(torch.tensor([0]), CONFIG, lost_table=0.0).points[0, :, 0].numpy()
    assert abs(np.corrcoef(x, np.arange(len(x)))[0, 1]) < 0.3


def test_settings_equal_those_of_train():
    config = train.train_config(None, ["network.sees_camera=false", "existence=listed"])
    assert not config.network.sees_camera
    assert config.existence == "listed"


def test_the_learning_rate_warms_up_and_falls_to_zero():
    cosine = schedule.Schedule(rate=1e-3, seconds=100.0, averaged=0.999)
    assert cosine.rate_at(0, 0.0) < 1e-5
    assert cosine.rate_at(schedule.WARM_UP_STEPS, 0.0) == pytest.approx(1e-3, rel=2e-3)
    assert cosine.rate_at(10_000, 100.0) == pytest.approx(schedule.SMALLEST_RATE)


def test_the_papers_learning_rate_falls_by_a_tenth_at_a_time():
    steps = schedule.Schedule(rate=1e-3, seconds=100.0, averaged=0.0, drops=20)
    found = [steps.rate_at(0, seconds) for seconds in (0.0, 4.9, 5.1, 100.0)]
    assert found == pytest.approx([1e-3, 1e-3, 0.9e-3, 0.9**20 * 1e-3])
    early = replace(steps, steps=1000)
    assert early.rate_at(50, 1.0) == pytest.approx(0.9e-3)


def test_the_preset_takes_regions_in_the_axes_of_the_camera(objects):
    config = train.train_config("paper")
    assert config.loss == "paper"
    region = EndlessScenes(objects[1], FEW, 1).regions(0)[0]
    ring = rendering.RegionRing(1, CPU)
    ring.add([np.asarray(each, np.float32)[None] for each in rendering._rows(region)])
    found = ring.batch(torch.tensor([0]), config, lost_table=0.0)
    own = region.points - region.points.mean(axis=0)
    spread = np.linalg.svd(np.cov(found.points[0].numpy().T))[0][:, 0]
    expected = np.linalg.svd(np.cov(own.T))[0][:, 0]
    assert abs(spread @ expected) > 0.95
    assert not found.ground.any()


CAMERA = Intrinsics(120.0, 120.0, 60.0, 44.0, 128, 96)


@pytest.fixture
def frames():
    rng = np.random.default_rng(0)
    regions = np.zeros((96, 128), np.uint8)
    regions[30:60, 20:50] = 1
    depth = np.where(regions > 0, 0.55, 0.6).astype(np.float32)
    depth[:5] = 0.0
    plane, made = Plane(np.array([0.0, 0.0, -1.0]), 0.6), []
    for _ in range(3):
        color = cv2.resize(rng.integers(0, 255, (6, 8, 3), np.uint8), (128, 96))
        made.append(DetectorFrame(SmallFrame(np.asarray(color), depth, CAMERA), plane, regions))
    return made


def test_frames_of_a_detector_arrive_as_they_were(frames, tmp_path):
    detector_frames.write(tmp_path / "root" / "scene_0000_kinect.h5", frames, STAMP)
    assert small_frames.write(tmp_path / "frames.npz", [tmp_path / "root"]) == 3
    found = small_frames.SmallFrames(tmp_path / "frames.npz")
    assert len(found) == 3
    for before, after in zip(frames, (found[k] for k in range(3)), strict=True):
        np.testing.assert_allclose(after.frame.depth, before.frame.depth, atol=0.0003)
        np.testing.assert_array_equal(after.regions, before.regions)
        assert after.frame.intrinsics == before.frame.intrinsics
        np.testing.assert_allclose(after.plane.normal, before.plane.normal)
        error = np.abs(after.frame.color.astype(int) - before.frame.color.astype(int))
        assert error.mean() < 6


def test_a_detector_learns_from_frames_and_keeps_the_mean_of_its_weights(frames, tmp_path):
    config = replace(FinetuneDetectorConfig(), detector=DetectorConfig(input="both"))
    rate = schedule.Schedule(rate=0.01, seconds=100.0, averaged=0.5)
    run = DetectorRun(starting_detector(config, 0), config, CPU, rate)
    before = {name: each.clone() for name, each in run.detector.state_dict().items()}
    batch = [random_example(frames[0], "both", np.random.default_rng(k)) for k in range(2)]
    for second in range(2):
        run.step(batch, float(second))
    run.save(tmp_path / "detector.safetensors")
    found, _ = read_weights(tmp_path / "detector.safetensors", MODEL_NAME, DetectorConfig)
    assert not torch.equal(found["backbone.stem.0.weight"], before["backbone.stem.0.weight"])
    assert found.keys() == before.keys()


def test_the_depth_stream_alone_gives_the_output_of_both_without_colour(tmp_path):
    config = replace(FinetuneDetectorConfig(), detector=DetectorConfig(input="both"))
    both = starting_detector(config, 0).eval()
    generator = torch.Generator().manual_seed(0)
    for weights in both.backbone.joins.parameters():
        weights.data.normal_(0.0, 0.1, generator=generator)
    path, out = tmp_path / "both.safetensors", tmp_path / "geometry.safetensors"
    save_weights(path, both.state_dict(), weights_metadata(MODEL_NAME, config.detector))
    geometry_stream.write(path, out)
    tensors, found = read_weights(out, MODEL_NAME, DetectorConfig)
    assert found.input == "geometry"
    alone = build_detector(found).eval()
    alone.load_state_dict(tensors)
    image = torch.randn(1, 9, 512, 512, generator=generator)
    image[:, :3] = 0.0
    with torch.inference_mode():
        expected, answer = both.backbone(image)["0"], alone.backbone(image[:, 3:])["0"]
    middle = (..., slice(56, 72), slice(56, 72))
    torch.testing.assert_close(answer[middle], expected[middle], atol=0.02, rtol=0.02)


def test_rows_of_one_seed_learn_separately_from_the_same_regions(objects, monkeypatch, tmp_path):
    for name in ("_normal", "_uniform", "_rotations"):  # replaced for the whole process
        monkeypatch.setattr(augmentation, name, getattr(augmentation, name))
    monkeypatch.setattr(torch, "set_default_device", lambda device: None)
    train.prepare_layers(CPU)
    region = EndlessScenes(objects[1], FEW, 1).regions(0)[0]
    ring = rendering.RegionRing(2, CPU)
    ring.add([np.asarray(each, np.float32)[None] for each in rendering._rows(region)])
    monkeypatch.setattr(ring, "take_in", lambda renderers, scenes: None)
    settings = "batch_size=2,network.num_points=300,num_loss_points=40"
    options = argparse.Namespace(out=tmp_path, graph=False, seeds=[0, 1])
    source = train_together.RenderedRegions(ring, None)
    sources = {Path("all.xz"): source, Path("uncut.xz"): source}
    texts = (
        f"full:{settings}",
        f"no_pift:{settings},network.use_pift=false",
        f"u@uncut.xz:{settings}",
    )
    plans = [train_together.RowPlan.of(text, Path("all.xz"), "paper") for text in texts]
    rows = [
        train_together.TrainedRow.of(plan, seed, ring, options) for plan in plans for seed in (0, 1)
    ]
    assert train_together.scene_seed(plans[0], options) == 0
    assert list(train_together.run_rounds(rows, sources, 60.0, 2)) == [1, 2]
    points = [row.step.sample.regions.points for row in rows]
    assert torch.equal(points[0], points[2])
    assert not torch.equal(points[0], points[1])
    assert not torch.equal(points[0], points[4])
    del rows[4:]
    for row in rows:
        row.write(tmp_path, 2)
    full, other, no_pift, _ = (
        read_weights(tmp_path / name, SymmetryGraspNet.__name__, NetworkConfig)
        for name in sorted(f"{row.name}_{row.seed}.safetensors" for row in rows)
    )
    assert full[1].use_pift
    assert not no_pift[1].use_pift
    assert not torch.equal(full[0][WEIGHT], other[0][WEIGHT])
    resumed = train_together.TrainedRow.of(plans[0], 0, ring, options)
    assert resumed.earlier == 2
    assert train_together.scene_seed(plans[0], options) not in options.seeds
    assert torch.equal(resumed.step.averaged_weights()[WEIGHT], full[0][WEIGHT])
    assert not torch.equal(resumed.step.sample.regions.points, points[0])
    path, samples = tmp_path / "full_0.safetensors", [resumed.step.sample]
    with torch.no_grad():
        loss = sample_loss(resumed.step.module.eval(), *samples, plans[0].config, CPU)["total"]
    assert compare_losses.mean_loss(path, plans[0], 2 * samples) == pytest.approx(float(loss))
    seeing, other = (
        train_together.RowPlan.of(f"full:{settings},network.{each}", Path("all.xz"), "paper")
        for each in ("sees_camera=true", "canonical_frame=true")  # the same shapes with the second
    )
    assert train_together.TrainedRow.of(seeing, 0, ring, options).earlier == 2
    assert compare_losses.mean_loss(path, seeing, samples) == pytest.approx(float(loss))
    for begin in (
        lambda: train_together.TrainedRow.of(other, 0, ring, options),
        lambda: compare_losses.mean_loss(path, other, samples),
    ):
        with pytest.raises(FormatError, match="canonical_frame=True is requested"):
            begin()


class Worker:
    """A process that renders, or has ended."""

    def __init__(self, alive):
        self.is_alive = lambda: alive


def renderers_of(waiting, *workers):
    made = object.__new__(rendering.Renderers)
    made.queue, made._workers = queue.Queue(), workers
    for each in waiting:
        made.queue.put(each)
    return made


def rendered(path, limit=None):
    """What a process that renders the objects of `path` puts into its queue before it ends."""
    out = queue.Queue()
    rendering._render(0, 1, path, 0, limit, out, threading.Event())
    return out.get_nowait()


def test_a_file_without_objects_ends_the_training_in_a_sentence(objects, tmp_path, monkeypatch):
    path = tmp_path / "objects.xz"
    for error, found in (
        (MissingInputError, rendered(path)),
        (FormatError, rendered(Path(__file__))),
    ):
        with pytest.raises(error, match="labelled_objects"):
            train.first_regions(renderers_of([found], Worker(alive=False)), 100, CPU)
    monkeypatch.setattr(labelled_objects, "read", lambda path: objects[1])
    assert isinstance(rendered(path, limit=0), ValueRangeError)


def test_objects_that_are_never_visible_end_the_training(monkeypatch):
    class Unseen:
        def regions(self, number):
            raise SymgraspError("no region is visible")

    monkeypatch.setattr(rendering, "scenes_of_file", lambda *_: Unseen())
    with pytest.raises(SymgraspError, match="no region is visible"):
        renderers_of([rendered(Path("objects.xz"))], Worker(alive=True)).waiting()


def test_a_training_ends_if_all_processes_that_render_have_ended():
    rows = [np.zeros((1, *each), np.float32) for each in rendering.SHAPES]
    renderers = renderers_of([rows], Worker(alive=False), Worker(alive=False))
    ring = rendering.RegionRing(4, CPU)
    with pytest.raises(SymgraspError, match="all processes that render regions have ended"):
        ring.take_in(renderers, 2)
    assert len(ring) == 1
    ring.take_in(renderers_of([], Worker(alive=False), Worker(alive=True)), 2)


def test_a_ring_has_room_for_two_scenes(monkeypatch):
    with pytest.raises(ValueRangeError, match="on the device is 10; it must be at least 40"):
        train.first_regions(renderers_of([], Worker(alive=True)), 10, CPU)


def test_successive_trainings_have_as_many_limits_of_steps_as_of_time(monkeypatch, capsys):
    words = ["train_together", "--objects", "o.xz", "--out", "o", "--row", "a"]
    words += ["--minutes", "1", "2", "--max-steps", "5"]
    monkeypatch.setattr("sys.argv", words)
    with pytest.raises(SystemExit) as ended:
        train_together.main()
    assert ended.value.code == 2
    assert "--max-steps needs one value for each of --minutes" in capsys.readouterr().err


@pytest.fixture
def ring(objects, monkeypatch):
    for name in ("_normal", "_uniform", "_rotations"):  # replaced for the whole process
        monkeypatch.setattr(augmentation, name, getattr(augmentation, name))
    monkeypatch.setattr(torch, "set_default_device", lambda device: None)
    train.prepare_layers(CPU)
    made = rendering.RegionRing(4, CPU)
    for region in EndlessScenes(objects[1], FEW, 1).regions(0):
        made.add([np.asarray(each, np.float32)[None] for each in rendering._rows(region)])
    return made


TINY = ["network.num_points=96", "num_loss_points=16"]


def run_options(tmp_path, **changed):
    options = {
        "device": "cpu", "preset": None, "set": TINY, "objects": None, "seed": 0, "workers": 1,
        "limit": None, "init": None, "capacity": 4, "batch_size": 2, "rate": 0.01, "graph": False,
        "minutes": 9.0, "averaged": 0.0, "drops": 0, "max_steps": 1,
        "out": tmp_path / "n.safetensors",
    }  # fmt: skip
    return argparse.Namespace(**{**options, **changed})


@pytest.fixture
def run_on_ring(ring, monkeypatch, tmp_path):
    monkeypatch.setattr(train, "Renderers", lambda *_: argparse.Namespace(end=lambda: None))
    monkeypatch.setattr(train, "first_regions", lambda *_: ring)
    monkeypatch.setattr(ring, "take_in", lambda renderers, scenes: None)
    return lambda **changed: train.run_training(run_options(tmp_path, **changed))


def test_weights_of_no_step_are_not_written(run_on_ring, tmp_path):
    with pytest.raises(ValueRangeError, match="--minutes is 0"):
        run_on_ring(minutes=0.0)
    assert not list(tmp_path.iterdir())


def test_only_weights_of_the_same_network_continue(run_on_ring, tmp_path):
    run_on_ring()
    first = tmp_path / "n.safetensors"
    run_on_ring(init=first, out=tmp_path / "more.safetensors")
    changed = [*TINY, "network.canonical_frame=false"]
    with pytest.raises(FormatError, match="canonical_frame=True"):
        run_on_ring(init=first, set=changed)


def test_the_learning_rate_counts_on_the_cpu_too(ring):
    config = train.train_config(None, TINY)
    module, sample = SymmetryGraspNet(config.network), train.drawn_sample(ring, 2, config)
    step = train.GraphStep(module.train(), sample, config, 0.01, as_graph=False)
    before = {name: each.detach().clone() for name, each in module.named_parameters()}
    step.run(sample, 0.0, 0.0)
    assert all(torch.equal(each, before[name]) for name, each in module.named_parameters())


def test_a_detector_has_frames_to_learn_from_before_processes_read_them(tmp_path):
    options = argparse.Namespace(frames=[tmp_path / "frames.npz"])
    with pytest.raises(MissingInputError, match="small_frames"):
        train_detector.train_detector(options)
    options.frames[0].write_bytes(b"no archive")
    with pytest.raises(FormatError, match="holds no frames of a detector"):
        train_detector.train_detector(options)
    with pytest.raises(ValueRangeError, match="number of frames in"):
        small_frames.write(tmp_path / "small.npz", [tmp_path])


def test_frames_of_graspnet_are_named_if_there_are_none(tmp_path):
    path = tmp_path / "frames.xz"
    with pytest.raises(MissingInputError, match="train-baseline graspnet"):
        graspnet_frames.pack_frames(path, tmp_path)
    with pytest.raises(MissingInputError, match="graspnet_frames pack"):
        graspnet_frames.unpack_frames(path, tmp_path)
    path.write_bytes(b"no archive")
    with pytest.raises(FormatError, match="holds no packed frames"):
        graspnet_frames.unpack_frames(path, tmp_path)
