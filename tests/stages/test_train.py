"""The train stage: weights that load, skipped and refused trainings."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch

from pipelines import train
from pipelines.dataset import object_list
from pipelines.dataset.object_list import ObjectRecord
from pipelines.dataset.training import packed_regions
from pipelines.dataset.training.packed_regions import PackedReader
from pipelines.errors import FormatError, SymgraspError, ValueRangeError
from pipelines.learning.loop.runs import CHECKPOINT, FAULT, RunRequest, file_of_run
from pipelines.network.model import SymmetryGraspNet
from pipelines.network.predictor import GraspPredictor
from pipelines.network.weights_files import weights_metadata
from pipelines.storage.checkpoints import load_weights, save_weights
from pipelines.storage.provenance import make_stamp
from tests.learning.packed_toys import CONFIG, write_packed
from tests.learning.stopped import stopped_after
from tests.stages.toy_root import STAMP, write_root
from tests.synthesis.test_endless import CONFIG as ENDLESS

REQUEST = RunRequest(device="cpu", threads=1)


@pytest.fixture(scope="module")
def packed(tmp_path_factory):
    return write_packed(tmp_path_factory.mktemp("packed"))


@pytest.fixture(scope="module")
def output(packed, tmp_path_factory):
    path = tmp_path_factory.mktemp("out") / "network.safetensors"
    train.run(packed, None, path, CONFIG, REQUEST)
    return path


def test_the_weights_load_into_the_predictor(output):
    region = np.random.default_rng(0).normal((0.0, 0.0, 0.6), 0.03, (300, 3))
    (prediction,) = GraspPredictor.load(output, "cpu").predict([region])
    assert np.isfinite(prediction.center).all()


def test_a_finished_training_is_skipped(packed, output):
    before = output.stat().st_mtime_ns
    report = train.run(packed, None, output, CONFIG, REQUEST)
    assert report.skipped == ["network.safetensors"]
    assert output.stat().st_mtime_ns == before


def test_weights_of_another_suffix_are_refused_before_anything_is_learned(packed, tmp_path):
    with pytest.raises(ValueRangeError, match=r"--out is .*x\.pt; it must be NAME\.safetensors"):
        train.run(packed, None, tmp_path / "x.pt", CONFIG, REQUEST)
    assert not list(tmp_path.iterdir())


def test_other_settings_are_refused(packed, output):
    with pytest.raises(SymgraspError, match="another config"):
        train.run(packed, None, output, replace(CONFIG, learning_rate=0.1), REQUEST)


def test_a_refused_training_names_the_settings_that_differ_and_both_values(packed, tmp_path):
    path, resumed = tmp_path / "network.safetensors", replace(REQUEST, resume=True)
    with stopped_after(1):
        train.run(packed, None, path, CONFIG, REQUEST)
    augmentation = replace(CONFIG.augmentation, scale=0.25)
    other = replace(CONFIG, learning_rate=0.1, augmentation=augmentation)
    with pytest.raises(SymgraspError) as caught:
        train.run(packed, None, path, other, replace(resumed, seed=REQUEST.seed + 1))
    assert str(caught.value).startswith(
        f"{tmp_path / 'network.checkpoint.safetensors'} was made with another config "
        f"(augmentation.scale = {CONFIG.augmentation.scale}, now 0.25; "
        f"learning_rate = {CONFIG.learning_rate}, now 0.1) and another seed (0, now 1); "
        "give the same settings and data to resume it"
    )


def test_a_resumed_training_equals_one_that_never_stopped(packed, output, tmp_path):
    path, resumed = tmp_path / "network.safetensors", replace(REQUEST, resume=True)
    report = train.run(packed, None, path, CONFIG, replace(REQUEST, max_seconds=0.0))
    assert report.notes[path.name].startswith("1 step in ")
    for steps in (3, 6):  # in the first epoch, in the second
        with stopped_after(steps):
            report = train.run(packed, None, path, CONFIG, resumed)
        assert report.notes[path.name].startswith(f"{steps} steps")
        assert path.read_bytes() != output.read_bytes()
    train.run(packed, None, path, CONFIG, resumed)
    assert path.read_bytes() == output.read_bytes()


def test_other_data_are_refused_whether_it_is_finished_or_to_be_resumed(packed, tmp_path):
    path, resumed = tmp_path / "network.safetensors", replace(REQUEST, resume=True)
    copy = shutil.copytree(packed, tmp_path / "packed")
    with stopped_after(3):
        train.run(copy, None, path, CONFIG, REQUEST)
    sorted(copy.iterdir())[0].unlink()
    with pytest.raises(SymgraspError, match="was made with other data; give the same settings and"):
        train.run(copy, None, path, CONFIG, resumed)


def test_scenes_without_a_region_are_neither_trained_on_nor_held_out(tmp_path):
    packed = write_packed(tmp_path / "packed", 2, 6)
    for number in range(5):
        scene = write_packed(tmp_path / "empty", 1, 0) / "scene_0000_kinect.h5"
        shutil.move(scene, packed / f"scene_{10 + number:04d}_kinect.h5")
    train_set, val_set = train.region_sets(packed, None, CONFIG, 0)
    assert (len(train_set.indices), len(val_set.indices)) == (6, 6)
    (packed / "scene_0001_kinect.h5").unlink()
    with pytest.raises(SymgraspError, match="packed scenes with regions is 1"):
        train.region_sets(packed, None, CONFIG, 0)
    (packed / "scene_0000_kinect.h5").unlink()
    with pytest.raises(SymgraspError, match=r"number of regions in .*packed is 0"):
        train.region_sets(None, packed, CONFIG, 0)


def test_scenes_for_validation_are_not_trained_on(packed, tmp_path):
    both = shutil.copytree(packed, tmp_path / "both")
    first, *_ = sorted(both.glob("*.h5"))
    (both / "val").mkdir()
    shutil.copy(first, both / "val" / "renamed.h5")
    with pytest.raises(ValueRangeError, match=r"--val is .*renamed\.h5"):
        train.region_sets(both, both / "val", CONFIG, 0)
    apart = tmp_path / "apart"
    (both / "val").rename(apart)
    first.unlink()
    train_set, val_set = train.region_sets(both, apart, CONFIG, 0)
    assert len(train_set.indices) + len(val_set.indices) == len(PackedReader(packed))


def test_scenes_that_are_packed_otherwise_are_not_validated_on(packed, tmp_path):
    scene = packed_regions.read(min(packed.glob("*.h5")))
    for name in ("train", "val"):
        stamp = make_stamp("pack", {"name": name}, inputs={"frames": "sha256:1"})
        (tmp_path / name).mkdir()
        packed_regions.write(tmp_path / name / "scene_0000_kinect.h5", scene, stamp)
    with pytest.raises(ValueRangeError, match=r"--val is .*val/scene_.*; it must be .*train/scene"):
        train.region_sets(tmp_path / "train", tmp_path / "val", CONFIG, 0)


def test_a_training_does_not_start_from_its_own_output(packed, output):
    overwriting = replace(REQUEST, overwrite=True)
    with pytest.raises(ValueRangeError, match=r"--init is .*; it must be another file than --out"):
        train.run(packed, None, output, CONFIG, overwriting, init=output)


def test_a_dataset_root_is_refused_as_packed_folder(tmp_path):
    (tmp_path / "scenes").mkdir()
    with pytest.raises(
        FormatError, match="is a dataset root; give the output folder of `symgrasp pack`"
    ):
        train.region_sets(tmp_path, None, CONFIG, 0)


def test_a_damaged_checkpoint_is_reported_in_one_sentence(packed, tmp_path):
    path = tmp_path / "network.safetensors"
    checkpoint, resumed = file_of_run(path, CHECKPOINT), replace(REQUEST, resume=True)
    with stopped_after(1):
        train.run(packed, None, path, CONFIG, REQUEST)
    whole = checkpoint.read_bytes()
    for damaged in (b"", whole[:100], whole[: len(whole) // 2]):
        checkpoint.write_bytes(damaged)
        with pytest.raises(SymgraspError, match="not a whole safetensors file"):
            train.run(packed, None, path, CONFIG, resumed)


def test_a_checkpoint_of_another_network_is_reported_in_one_sentence(packed, tmp_path):
    path = tmp_path / "network.safetensors"
    with stopped_after(1):
        train.run(packed, None, path, CONFIG, REQUEST)
    tensors, metadata = load_weights(file_of_run(path, CHECKPOINT))
    lacking = {name: each for name, each in tensors.items() if "power" not in name}
    save_weights(file_of_run(path, CHECKPOINT), lacking, metadata)
    with pytest.raises(SymgraspError, match="its tensors do not fit the network"):
        train.run(packed, None, path, CONFIG, replace(REQUEST, resume=True))


def test_a_network_that_diverges_saves_its_batch(packed, tmp_path):
    path = tmp_path / "network.safetensors"
    wild = replace(CONFIG, learning_rate=1e30)
    with pytest.raises(SymgraspError, match=r"it must be finite; .* holds the batch"):
        train.run(packed, None, path, wild, REQUEST)
    assert not np.isfinite(train.replay(file_of_run(path, FAULT))["total"])


def test_a_separate_folder_can_be_used_for_validation(packed, tmp_path):
    other = write_packed(tmp_path / "val", 4)
    for scene in sorted(other.glob("*.h5"))[:3]:  # these scenes are trained on
        scene.unlink()
    path = tmp_path / "network.safetensors"
    report = train.run(packed, other, path, replace(CONFIG, epochs=1), REQUEST)
    assert "plane_angle_deg" in report.notes["network.safetensors"]


def test_impossible_numbers_of_objects_are_refused_before_rendering(packed, tmp_path):
    root = write_root(tmp_path / "root").root
    config = replace(CONFIG, endless=replace(ENDLESS, share=0.5, min_objects=5, max_objects=4))
    with pytest.raises(ValueRangeError, match="min_objects is 5; it must be at most max_objects"):
        train.run(packed, None, tmp_path / "n.safetensors", config, REQUEST, endless=[root])


def test_a_training_on_rendered_and_packed_regions_resumes_to_the_same_bytes(packed, tmp_path):
    root = write_root(tmp_path / "root").root
    records = [ObjectRecord(i, f"object{i}", "toy", "seen") for i in range(3)]
    object_list.write(root / "objects.json", records, STAMP)
    endless = replace(ENDLESS, share=0.5, scenes_together=2)  # two groups are rendered ahead
    config = replace(CONFIG, epochs=1, endless=endless)
    outputs = [tmp_path / name / "network.safetensors" for name in ("whole", "halves")]
    train.run(packed, None, outputs[0], config, REQUEST, endless=[root])
    with stopped_after(2):
        train.run(packed, None, outputs[1], config, REQUEST, endless=[root])
    resumed = replace(REQUEST, resume=True)
    train.run(packed, None, outputs[1], config, resumed, endless=[root])
    assert outputs[0].read_bytes() == outputs[1].read_bytes()


def test_training_only_on_rendered_regions_needs_a_validation_folder(tmp_path):
    with pytest.raises(SymgraspError, match="--val is not given"):
        train.run(None, None, tmp_path / "x.safetensors", CONFIG, REQUEST)


def weights_of(path, network):
    torch.manual_seed(1)
    metadata = weights_metadata("SymmetryGraspNet", network)
    save_weights(path, SymmetryGraspNet(network).state_dict(), metadata)
    return path


def test_a_network_starts_from_given_weights(tmp_path):
    path = weights_of(tmp_path / "w.safetensors", CONFIG.network)
    start = train.build(CONFIG, 0, None).state_dict()
    found, expected = train.build(CONFIG, 0, path).state_dict(), load_weights(path)[0]
    assert all(torch.equal(found[name], expected[name]) for name in found)
    assert not all(torch.equal(found[name], start[name]) for name in found)


BLIND = replace(CONFIG, network=replace(CONFIG.network, sees_camera=False))


def test_a_network_that_sees_the_camera_begins_as_one_that_does_not(tmp_path):
    path = weights_of(tmp_path / "w.safetensors", BLIND.network)
    narrow, wide = (train.build(each, 0, path).eval() for each in (BLIND, CONFIG))
    torch.manual_seed(0)
    points, camera = 0.05 * torch.randn(2, CONFIG.network.num_points, 3), torch.randn(2, 3)
    with torch.no_grad():
        before, after = narrow(points), wide(points, camera=camera)
    torch.testing.assert_close(after.center, before.center)
    torch.testing.assert_close(after.existence, before.existence)


def test_truncated_weights_are_not_filled_up_for_a_network_that_sees_the_camera(tmp_path):
    path = weights_of(tmp_path / "w.safetensors", BLIND.network)
    tensors, metadata = load_weights(path)
    name = max(tensors, key=lambda each: tensors[each].numel())
    save_weights(path, tensors | {name: tensors[name][..., :-1].contiguous()}, metadata)
    with pytest.raises(FormatError, match="do not fit the network"):
        train.build(CONFIG, 0, path)


def test_weights_of_a_network_that_sees_the_camera_start_no_network_that_does_not(tmp_path):
    path = weights_of(tmp_path / "w.safetensors", CONFIG.network)
    with pytest.raises(FormatError, match="sees_camera=True; sees_camera=False is requested"):
        train.build(BLIND, 0, path)


def test_weights_of_a_network_with_other_settings_are_refused(tmp_path):
    other = replace(CONFIG.network, canonical_frame=False)
    path = weights_of(tmp_path / "w.safetensors", other)
    expected = r"with canonical_frame=False; canonical_frame=True is requested"
    with pytest.raises(FormatError, match=expected):
        train.build(CONFIG, 0, path)
    train.build(replace(CONFIG, network=other), 0, path)
