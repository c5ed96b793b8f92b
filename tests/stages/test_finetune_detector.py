"""The finetune-detector stage on a toy dataset: frames prepared once, weights that load."""

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from pipelines import finetune_detector
from pipelines.configs import DetectorConfig, FinetuneDetectorConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.training import detector_frames
from pipelines.dataset.training.region_frames import split_frames
from pipelines.errors import SymgraspError, ValueRangeError
from pipelines.inference import models
from pipelines.learning.detector.detector_start import starting_detector
from pipelines.learning.detector.detector_training import DetectorTraining, spread
from pipelines.learning.loop.faults import save_fault
from pipelines.learning.loop.runs import RunRequest
from pipelines.learning.speed.gradients import loss_seed
from pipelines.network.detection.detector import RegionDetector
from pipelines.runtime.batch import BatchOptions
from pipelines.storage import provenance
from pipelines.storage.checkpoints import load_weights
from pipelines.storage.h5_files import open_h5
from pipelines.storage.provenance import make_stamp
from symgrasp_cli.app import app
from tests.learning.stopped import stopped_after
from tests.stages.toy_root import write_root

CONFIG = FinetuneDetectorConfig(
    detector=DetectorConfig(min_size=96, max_size=128, min_confidence=0.0),
    epochs=2,  # of one step each
    batch_size=2,
    micro_batch_size=1,
    min_pixels=50,
)
SHORT = replace(CONFIG, epochs=1, frame_stride=2)
REQUEST = RunRequest(device="cpu", threads=1)
QUIET = BatchOptions(progress=False)


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    return write_root(tmp_path_factory.mktemp("root"))


@pytest.fixture(scope="module")
def output(root, tmp_path_factory):
    path = tmp_path_factory.mktemp("out") / "detector.safetensors"
    finetune_detector.run([root.root], path, CONFIG, REQUEST, split=None, options=QUIET)
    return path


def prepare(root, output, config=CONFIG):
    items = finetune_detector.scene_items(root.root, output, config)
    return finetune_detector.prepare(root.root, items, config, QUIET)


def test_weights_of_another_model_are_named_before_frames_are_prepared(root, tmp_path):
    output = tmp_path / "detector.safetensors"
    with pytest.raises(SymgraspError, match="network"):
        finetune_detector.run(
            [root.root], output, SHORT, REQUEST, split=None, init=models.NETWORK_WEIGHTS
        )
    assert not output.with_name("detector.frames").exists()


def test_a_detector_does_not_start_from_its_own_output(tmp_path):
    path = tmp_path / "detector.safetensors"
    path.touch()
    with pytest.raises(ValueRangeError, match=r"--init is .*; it must be another file than --out"):
        finetune_detector.run([tmp_path], path, SHORT, REQUEST, init=path)


def test_frames_are_prepared_with_their_regions(root, output):
    files = sorted(finetune_detector.frames_folder(output, root.root).glob("*.h5"))
    assert len(files) == 2
    frame = detector_frames.read(files[0], 0)
    assert frame.regions.shape == frame.frame.depth.shape == (96, 128)
    assert set(np.unique(frame.regions)) == {0, 1, 2, 3}
    heights = frame.plane.height(frame.frame.intrinsics.backproject(frame.frame.depth))
    assert np.nanmedian(heights[frame.regions > 0]) > 0.02
    assert abs(np.nanmedian(heights[frame.regions == 0])) < 0.005


def test_frames_are_compressed_to_the_same_bytes_in_every_process(root, output):
    (path, *_) = finetune_detector.frames_folder(output, root.root).glob("*.h5")
    with open_h5(path) as file:  # LZF output may depend on earlier content of the memory
        assert {file[name].compression for name in ("color", "depth", "regions")} == {"gzip"}


def test_the_weights_load_into_the_detector(root, output):
    frame = root.read_frame(root.scenes()[0].frames()[0])
    detector = RegionDetector.load(output, "cpu")
    for found in detector.examine(frame.color, frame.depth, frame.intrinsics).detections:
        assert found.mask.shape == frame.depth.shape
        assert 0.0 <= found.confidence <= 1.0


def test_a_finished_training_is_skipped(root, output):
    report = finetune_detector.run([root.root], output, CONFIG, REQUEST, split=None, options=QUIET)
    assert report.skipped == ["detector.safetensors"]


def test_a_resumed_training_equals_one_that_never_stopped(root, output, tmp_path):
    path = tmp_path / output.name
    with stopped_after(1):
        report = finetune_detector.run(
            [root.root], path, CONFIG, REQUEST, split=None, options=QUIET
        )
    assert report.notes[path.name].startswith("1 step in ")
    assert "finished" not in report.notes[path.name]
    resumed = replace(REQUEST, resume=True)
    report = finetune_detector.run([root.root], path, CONFIG, resumed, split=None, options=QUIET)
    assert report.done
    assert path.read_bytes() == output.read_bytes()


def test_the_stride_of_the_frames_is_an_option_and_cannot_change_on_resume(root, tmp_path):
    path = tmp_path / "detector.safetensors"
    call = ["finetune-detector", str(root.root), "--out", str(path), "--split", "all"]
    call += ["--frame-stride", "2", "--max-seconds", "0", "--device", "cpu", "--workers", "1"]
    call += [f"--set=detector.{each}" for each in ("min_size=96", "max_size=128")]
    assert CliRunner().invoke(app, call).exit_code == 0
    files = sorted(finetune_detector.frames_folder(path, root.root).glob("*.h5"))
    assert [detector_frames.count_frames(file) for file in files] == [1, 1]
    result = CliRunner().invoke(app, [*call, "--resume", "--frame-stride", "1"])
    assert result.exit_code == 1
    assert "was made with another config" in result.output


def test_a_scene_with_new_frames_is_prepared_again(tmp_path):
    root = write_root(tmp_path / "root")
    config, output = CONFIG, tmp_path / "detector.safetensors"
    prepared = prepare(root, output, config)
    assert prepared.done
    scene = root.scenes()[0]
    for path in scene.camera_folder.glob("*/0001.*"):
        path.rename(path.with_suffix(".away"))
    again = prepare(root, output, config)
    assert len(again.failed) == 1
    assert "other settings or inputs" in next(iter(again.failed.values()))


def test_damaged_frames_are_prepared_again(root, tmp_path):
    output = tmp_path / "detector.safetensors"
    assert prepare(root, output).done
    damaged = next((tmp_path / "detector.frames").rglob("*.h5"))
    whole = damaged.read_bytes()
    damaged.write_bytes(whole[:-100])
    assert len(prepare(root, output).done) == 1
    assert damaged.read_bytes() == whole


def test_weights_trained_by_another_version_are_reused(root, output, monkeypatch):
    monkeypatch.setattr(provenance, "version", lambda: "9.9.9")
    again = finetune_detector.run([root.root], output, CONFIG, REQUEST, split=None, options=QUIET)
    assert again.skipped == [output.name]


def test_other_pictures_of_the_same_names_count_as_other_data(root, output, tmp_path):
    copy = tmp_path / root.root.name
    shutil.copytree(root.root, copy)
    shutil.copytree(output.parent, tmp_path / "out")
    path = tmp_path / "out" / output.name
    again = finetune_detector.run([copy], path, CONFIG, REQUEST, split=None, options=QUIET)
    assert again.skipped
    picture = sorted(copy.glob("scenes/*/*/rgb/0000.png"))[0]
    cv2.imwrite(str(picture), 255 - cv2.imread(str(picture)) // 2)
    with pytest.raises(SymgraspError, match="other data"):
        finetune_detector.run([copy], path, CONFIG, REQUEST, split=None, options=QUIET)
    assert len(prepare(GraspNetRoot(copy), path).failed) == 1


def test_a_scene_without_frames_gets_an_empty_file(tmp_path):
    detector_frames.write(tmp_path / "scene.h5", [], make_stamp("finetune-detector", CONFIG))
    assert detector_frames.count_frames(tmp_path / "scene.h5") == 0


def test_other_coco_weights_count_as_another_training(root, output):
    again = finetune_detector.run([root.root], output, CONFIG, REQUEST, split=None, options=QUIET)
    assert again.skipped
    with pytest.raises(SymgraspError, match="other data"):
        finetune_detector.run(
            [root.root], output, CONFIG, REQUEST, split=None, options=QUIET,
            coco_weights="nowhere.pth",
        )  # fmt: skip


def test_the_frames_of_a_scenes_two_cameras_are_on_one_side():
    cameras = ("kinect", "realsense")
    files = [Path(f"scene_{n:04d}_{camera}.h5") for n in range(12) for camera in cameras]
    for seed in range(10):
        frames = split_frames(files, lambda _: 2, 0.3, seed)
        sides = [{path.stem[:10] for path, _ in keys} for keys in (frames.train, frames.val)]
        assert sides[0].isdisjoint(sides[1])
        assert len(sides[0]) + len(sides[1]) == 12


@pytest.mark.parametrize(
    ("count", "fraction", "missing"), [(2, 0.0, "to validate on"), (0, 0.3, "to train on")]
)
def test_a_side_without_frames_is_refused(count, fraction, missing):
    files = [Path(f"scene_{n:04d}_kinect.h5") for n in range(4)]
    with pytest.raises(ValueRangeError, match=f"number of frames {missing}"):
        split_frames(files, lambda _: count, fraction, 0)


def test_a_saved_batch_gives_the_same_losses_again(root, output, tmp_path):
    files = sorted(finetune_detector.frames_folder(output, root.root).glob("*.h5"))
    frames = split_frames(files, detector_frames.count_frames, CONFIG.val_fraction, 0)
    detector = starting_detector(CONFIG, 0)
    trainee = DetectorTraining(detector, frames, CONFIG, torch.device("cpu"))
    batch = trainee.load(np.arange(2), [np.random.default_rng(i) for i in range(2)])
    place, path = (0, 1, 2, 3), tmp_path / "detector.fault.safetensors"
    save_fault(
        path, detector, trainee.tensors(batch), place, make_stamp("finetune-detector", CONFIG)
    )
    drawing = torch.Generator().manual_seed(loss_seed(*place))
    terms = trainee.loss(detector.train(), batch, drawing)
    expected = {name: float(each.detach()) for name, each in terms.items()}
    assert finetune_detector.replay(path) == pytest.approx(expected, rel=1e-5)


def test_the_detector_starts_from_given_weights(root, output, tmp_path):
    still = replace(SHORT, learning_rate=0.0, ema_decay=0.0)
    path = tmp_path / "again.safetensors"
    finetune_detector.run([root.root], path, still, REQUEST, split=None, init=output, options=QUIET)
    before, after = load_weights(output)[0], load_weights(path)[0]
    name = "roi_heads.box_predictor.bbox_pred.weight"
    torch.testing.assert_close(after[name], before[name])


def test_frames_prepared_with_other_labels_are_not_reused(root, output, tmp_path):
    copy = tmp_path / root.root.name
    shutil.copytree(root.root, copy)
    label = sorted((copy / "symmetry").glob("*.json"))[0]
    label.write_text(label.read_text() + "\n")
    report = prepare(GraspNetRoot(copy), output, CONFIG)
    assert report.failed
    assert all(
        "other settings" in sentence or "otherwise" in sentence
        for sentence in report.failed.values()
    )


def test_the_detector_learns_from_several_roots(root, tmp_path):
    other = tmp_path / "other"
    shutil.copytree(root.root, other)
    path, roots = tmp_path / "detector.safetensors", [root.root, other]
    report = finetune_detector.run(roots, path, SHORT, REQUEST, split=None, options=QUIET)
    assert report.done == ["detector.safetensors"]
    files = [sorted(finetune_detector.frames_folder(path, each).glob("*.h5")) for each in roots]
    assert [file.name for file in files[0]] == [file.name for file in files[1]]
    scenes = [f"{file.parent.name}/{file.stem}" for each in files for file in each]
    frames = finetune_detector.frames_of(roots, path, scenes, SHORT.val_fraction, 0)
    for keys in frames.train, frames.val:
        assert {file.parent.name for file, _ in keys} == {root.root.name, "other"}
    assert not set(frames.train) & set(frames.val)


def test_scenes_prepared_earlier_with_another_split_are_not_learned(root, tmp_path, monkeypatch):
    both = tmp_path / "both"
    shutil.copytree(root.root, both)
    for number in (101, 161):  # two of `seen`, two of `novel`
        shutil.copytree(
            both / f"scenes/scene_{number - 1:04d}", both / f"scenes/scene_{number:04d}"
        )
    path, frames = tmp_path / "detector.safetensors", []
    with stopped_after(0):
        finetune_detector.run([both], path, SHORT, REQUEST, split=None, options=QUIET)
    resumed = replace(REQUEST, resume=True)
    with pytest.raises(SymgraspError, match="was made with other data"):
        finetune_detector.run([both], path, SHORT, resumed, split="seen", options=QUIET)
    made = DetectorTraining.__init__

    def watched(trainee, detector, sets, *rest):
        frames.append(sets)
        made(trainee, detector, sets, *rest)

    monkeypatch.setattr(DetectorTraining, "__init__", watched)
    with stopped_after(0):
        again = replace(REQUEST, overwrite=True)
        finetune_detector.run([both], path, SHORT, again, split="seen", options=QUIET)
    shown = {file.stem[:10] for file, _ in frames[0].train + frames[0].val}
    assert shown == {"scene_0100", "scene_0101"}


@pytest.mark.parametrize(("frames", "judged"), [(0, 0), (7, 7), (120, 120), (121, 120), (239, 120)])
def test_no_more_frames_are_validated_than_requested(frames, judged):
    keys = [(Path("scene.h5"), row) for row in range(frames)]
    chosen = spread(keys, 120)
    assert len(chosen) == len(set(chosen)) == judged
    assert np.diff([row for _, row in chosen]).max(initial=0) <= 2


def test_bad_scenes_of_all_roots_are_named_before_anything_is_learned(root, tmp_path):
    roots = [tmp_path / "first", tmp_path / "second"]
    for number, each in enumerate(roots):
        shutil.copytree(root.root, each)
        scene = GraspNetRoot(each).scenes()[number]
        scene.frames()[0].path("label").unlink()
    path = tmp_path / "detector.safetensors"
    report = finetune_detector.run(roots, path, CONFIG, REQUEST, split=None, options=QUIET)
    assert [name.split("/")[0] for name in report.failed] == ["first", "second"]
    assert [name.split("/")[0] for name in report.done] == ["first", "second"]
    assert not path.exists()


def test_roots_of_one_name_are_refused(root, tmp_path):
    namesake = tmp_path / root.root.name
    with pytest.raises(ValueRangeError, match="folders of different names"):
        finetune_detector.run([root.root, namesake], tmp_path / "d.safetensors", CONFIG, REQUEST)


def test_a_split_without_scenes_is_refused(root, tmp_path):
    with pytest.raises(SymgraspError, match="no similar scene"):
        finetune_detector.run(
            [root.root], tmp_path / "d.safetensors", CONFIG, REQUEST, split="similar", options=QUIET
        )
