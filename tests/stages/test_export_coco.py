"""The export-coco stage: COCO's readers open its output; the detector trains on its masks."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pycocotools.coco import COCO
from torchvision.datasets import CocoDetection

from pipelines import export_coco, finetune_detector
from pipelines.configs import DetectorConfig, ExportCocoConfig, FinetuneDetectorConfig
from pipelines.dataset.graspnet.graspnet_layout import SceneFiles
from pipelines.dataset.training import coco_instances, detector_frames
from pipelines.dataset.training.region_frames import (
    held_out_scenes,
    read_region_frame,
    split_frames,
)
from pipelines.errors import FormatError, StaleOutputError, SymgraspError, UnknownNameError
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, SphereSymmetry
from pipelines.learning.loop.runs import RunRequest
from pipelines.runtime.batch import BatchOptions, WorkItem
from pipelines.storage.provenance import make_stamp
from tests.stages.toy_root import FRAMES, SCENES, write_root

CONFIG = ExportCocoConfig(min_pixels=50)
DETECTOR = FinetuneDetectorConfig(detector=DetectorConfig(min_size=96, max_size=128), min_pixels=50)
QUIET = BatchOptions(progress=False)
X, Z, ORIGIN = np.eye(3)[0], np.eye(3)[2], np.zeros(3)


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    return write_root(tmp_path_factory.mktemp("root"))


@pytest.fixture(scope="module")
def exported(root, tmp_path_factory):
    folder = tmp_path_factory.mktemp("coco")
    report = export_coco.run(root.root, folder, CONFIG, split=None, options=QUIET)
    assert len(report.done) == len(SCENES)
    assert report.has_next
    return folder


def coco(folder, split="train"):
    return COCO(coco_instances.annotations_path(folder, split))


def test_pycocotools_opens_both_splits(exported):
    ids = {split: set(coco(exported, split).getImgIds()) for split in ("train", "val")}
    assert len(ids["train"]) == len(ids["val"]) == len(FRAMES)
    assert not ids["train"] & ids["val"]
    annotations = coco(exported).loadAnns(coco(exported).getAnnIds())
    assert {a["category_id"] for a in annotations} == {1, 2, 3}
    names = {c["id"]: c["name"] for c in coco(exported).loadCats(coco(exported).getCatIds())}
    assert names == {1: "reflection", 2: "rotation", 3: "sphere", 4: "none"}


def test_torchvision_opens_images_with_their_targets(exported):
    path = coco_instances.annotations_path(exported, "val")
    dataset = CocoDetection(exported / "images", path)
    image, target = dataset[0]
    assert image.size == (320, 240)
    assert len(target) == 3


@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")
def test_masks_areas_and_boxes_equal_those_of_the_frame(root, exported):
    for split in coco_instances.COCO_SPLITS:
        api = coco(exported, split)
        for frame in coco_instances.read_coco_frames(exported, split):
            files = root.frame(f"{frame.files.name}")
            regions = read_region_frame(root, files, CONFIG.min_pixels).regions
            assert len(regions) == len(frame.annotations) == 3
            for region, annotation in zip(regions, frame.annotations, strict=True):
                assert np.array_equal(api.annToMask(annotation), region.mask)
                rows, columns = np.nonzero(region.mask)
                x, y, w, h = annotation["bbox"]
                assert (x, y) == (columns.min(), rows.min())
                assert (x + w - 1, y + h - 1) == (columns.max(), rows.max())
                assert annotation["area"] == region.mask.sum()
                assert annotation["iscrowd"] == 0


@pytest.mark.parametrize("files", [0, 3, 5])
def test_a_run_stopped_at_any_moment_and_resumed_writes_the_same_bytes(
    root, exported, tmp_path, monkeypatch, files
):
    copied = []

    def stopped(source, target):
        if len(copied) == files:
            Path(target).write_bytes(b"half")
            raise KeyboardInterrupt
        copied.append(target)
        Path(target).write_bytes(Path(source).read_bytes())

    with monkeypatch.context() as patch:
        patch.setattr("pipelines.export_coco.shutil.copyfile", stopped)
        with pytest.raises(KeyboardInterrupt):
            export_coco.run(root.root, tmp_path, CONFIG, split=None, options=QUIET)
    assert not list(tmp_path.glob("annotations/*"))
    export_coco.run(root.root, tmp_path, CONFIG, split=None, options=QUIET)
    written = {p.relative_to(tmp_path): p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    assert written == {
        p.relative_to(exported): p.read_bytes() for p in exported.rglob("*") if p.is_file()
    }


def test_the_detector_reads_the_same_frames_from_both_datasets(root, exported, tmp_path):
    outputs = [tmp_path / "a.safetensors", tmp_path / "b.safetensors"]
    for source, output in zip([root.root, exported], outputs, strict=True):
        items = finetune_detector.scene_items(source, output, DETECTOR)
        assert not finetune_detector.prepare(source, items, DETECTOR, QUIET).failed
    folders = [
        finetune_detector.frames_folder(output, source)
        for output, source in zip(outputs, [root.root, exported], strict=True)
    ]
    names = sorted(path.name for path in folders[0].iterdir())
    assert names == sorted(path.name for path in folders[1].iterdir())
    for name in names:
        for row in range(len(FRAMES)):
            first, second = (detector_frames.read(folder / name, row) for folder in folders)
            assert np.array_equal(first.regions, second.regions)
            assert np.array_equal(first.frame.depth, second.frame.depth)
            assert np.array_equal(first.frame.color, second.frame.color)
            assert first.frame.intrinsics == second.frame.intrinsics


def test_the_detector_validates_on_the_datasets_own_split(exported, tmp_path):
    output = tmp_path / "d.safetensors"
    items = finetune_detector.scene_items(exported, output, DETECTOR)
    finetune_detector.prepare(exported, items, DETECTOR, QUIET)
    files = sorted(finetune_detector.frames_folder(output, exported).glob("*.h5"))
    for scene in (f"scene_{number:04d}" for number in SCENES):
        sets = split_frames(files, detector_frames.count_frames, 0.1, 0, {scene})
        assert {path.stem[:10] for path, _ in sets.val} == {scene}
        assert {path.stem[:10] for path, _ in sets.train} == {
            f"scene_{number:04d}" for number in SCENES
        } - {scene}


def test_the_detector_trains_on_the_coco_dataset(exported, tmp_path):
    output = tmp_path / "detector.safetensors"
    config = replace(DETECTOR, epochs=1, batch_size=2, micro_batch_size=1)
    request = RunRequest(device="cpu", threads=1)
    report = finetune_detector.run([exported], output, config, request, options=QUIET)
    assert report.done == [output.name]
    assert output.is_file()
    again = finetune_detector.run([exported], output, config, request, options=QUIET)
    assert again.skipped == [output.name]


def test_a_second_run_skips_and_writes_the_same(root, exported):
    path = coco_instances.annotations_path(exported, "train")
    before = path.read_bytes()
    report = export_coco.run(root.root, exported, CONFIG, split=None, options=QUIET)
    assert len(report.skipped) == len(SCENES)
    assert path.read_bytes() == before


def test_more_workers_write_the_same_bytes(root, exported, tmp_path):
    options = BatchOptions(progress=False, workers=2, backend="threading")
    export_coco.run(root.root, tmp_path, CONFIG, split=None, options=options)
    for path in exported.rglob("*"):
        if path.is_file():
            assert (tmp_path / path.relative_to(exported)).read_bytes() == path.read_bytes()


def test_links_lead_to_the_datasets_images(root, tmp_path):
    config = ExportCocoConfig(min_pixels=50, link=True, frame_stride=2, categories="object")
    export_coco.run(root.root, tmp_path, config, split="seen", options=QUIET)
    pictures = sorted((tmp_path / "images").rglob("*.png"))
    assert len(pictures) == 2
    assert all(path.is_symlink() and path.is_file() for path in pictures)
    content = json.loads(coco_instances.annotations_path(tmp_path, "train").read_text())
    assert [category["name"] for category in content["categories"]] == ["000", "001", "002"]
    assert all(a["category_id"] == a["object_id"] + 1 for a in content["annotations"])
    assert content["provenance"]["stage"] == "export-coco"


@pytest.mark.parametrize("link", [False, True])
def test_a_camera_that_is_not_copied_is_named_as_missing(tmp_path, link):
    root, config = write_root(tmp_path / "root"), replace(CONFIG, link=link)
    camera = root.scenes()[0].camera_folder / "camK.npy"
    camera.unlink()
    report = export_coco.run(root.root, tmp_path / "out", config, split=None, options=QUIET)
    (sentence,) = report.failed.values()
    assert sentence.startswith(f"{camera} does not exist; ")


@pytest.mark.parametrize("link", [False, True])
def test_lost_images_of_a_finished_scene_are_restored(root, tmp_path, link):
    config = replace(CONFIG, link=link)
    export_coco.run(root.root, tmp_path, config, split=None, options=QUIET)
    before = contents(tmp_path)
    lost = next((tmp_path / "images").rglob("depth/0001.png"))
    lost.unlink()
    if link:
        lost.symlink_to(tmp_path / "moved")
    report = export_coco.run(root.root, tmp_path, config, split=None, options=QUIET)
    assert (len(report.done), len(report.skipped)) == (1, len(SCENES) - 1)
    assert contents(tmp_path) == before


def test_other_settings_are_refused_and_unknown_ones_named(root, exported, tmp_path):
    other = ExportCocoConfig(min_pixels=60)
    report = export_coco.run(root.root, exported, other, split=None, options=QUIET)
    assert len(report.failed) == len(SCENES)
    assert all("--overwrite" in sentence for sentence in report.failed.values())
    with pytest.raises(UnknownNameError, match="kind, object, region"):
        export_coco.run(root.root, tmp_path, ExportCocoConfig("color"), split=None)
    with pytest.raises(SymgraspError, match="no similar scene"):
        export_coco.run(root.root, tmp_path, CONFIG, split="similar")


def test_a_damaged_scene_fails_alone(root, tmp_path):
    copy = write_root(tmp_path / "root")
    label = copy.scenes()[0].frames()[0].path("label")
    label.write_bytes(label.read_bytes()[:50])
    report = export_coco.run(copy.root, tmp_path / "out", CONFIG, split=None, options=QUIET)
    assert len(report.done) == len(report.failed) == 1
    assert not (tmp_path / "out" / "scenes" / f"{next(iter(report.failed))}.json").exists()
    assert not (tmp_path / "out" / "annotations").exists()
    assert report.notes["splits"] == "not joined to annotations/, as 1 of 2 scenes failed"


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


OTHERS = {
    "another split": (CONFIG, {"split": "seen"}),
    "another share": (replace(CONFIG, val_fraction=0.0), {"split": None}),
    "another seed": (CONFIG, {"split": None, "seed": 1}),
}


@pytest.mark.parametrize("other", OTHERS)
def test_annotations_of_an_earlier_run_are_replaced_only_on_request(
    root, exported, tmp_path, other
):
    out, (config, arguments) = shutil.copytree(exported, tmp_path / "out"), OTHERS[other]
    before = contents(out)
    with pytest.raises(StaleOutputError, match=r"instances_train.json .* --overwrite"):
        export_coco.run(root.root, out, config, **arguments, options=QUIET)
    assert contents(out) == before
    options = replace(QUIET, overwrite=True)
    assert not export_coco.run(root.root, out, config, **arguments, options=options).failed
    assert contents(out) != before


def test_a_stale_scene_does_not_change_the_annotations(tmp_path):
    copy, out = write_root(tmp_path / "root"), tmp_path / "out"
    export_coco.run(copy.root, out, CONFIG, split=None, options=QUIET)
    before = contents(out)
    np.save(copy.scenes()[0].camera_folder / "camK.npy", np.diag([301.0, 301.0, 1.0]))
    report = export_coco.run(copy.root, out, CONFIG, split=None, options=QUIET)
    assert list(report.failed) == [copy.scenes()[0].name]
    assert len(report.skipped) == 1
    assert contents(out) == before


def test_a_share_of_zero_holds_out_no_scene(root, tmp_path):
    config = replace(CONFIG, val_fraction=0.0)
    report = export_coco.run(root.root, tmp_path, config, split=None, options=QUIET)
    assert report.notes["splits"].endswith("val: 0 images, 0 regions")
    assert len(coco(tmp_path).getImgIds()) == len(SCENES) * len(FRAMES)
    assert not coco(tmp_path, "val").getImgIds()
    assert not report.has_next


def test_a_dataset_of_another_maker_is_reported_in_one_sentence(tmp_path):
    path = coco_instances.annotations_path(tmp_path, "train")
    path.parent.mkdir()
    path.write_text(json.dumps({"images": [{"id": 1, "file_name": "a.png"}], "annotations": []}))
    with pytest.raises(FormatError, match="scene_id"):
        coco_instances.read_coco_frames(tmp_path, "train")


@pytest.mark.parametrize("annotations", [[{"id": 1}], None, 3, [[1]]])
def test_damaged_annotations_are_reported_in_one_sentence(annotations, tmp_path):
    path = coco_instances.annotations_path(tmp_path, "train")
    path.parent.mkdir()
    path.write_text(json.dumps({"images": [], "annotations": annotations}))
    with pytest.raises(FormatError, match="an image or annotation is not right"):
        coco_instances.read_coco_frames(tmp_path, "train")


def test_the_category_of_a_region_is_its_strongest_symmetry():
    plane, axis = ReflectionSymmetry(X, ORIGIN), RotationSymmetry(Z, ORIGIN)
    assert coco_instances.kind_of([plane, axis]) == "rotation"
    assert coco_instances.kind_of([plane, RotationSymmetry(Z, ORIGIN, 2)]) == "reflection"
    assert coco_instances.kind_of([SphereSymmetry(ORIGIN)]) == "sphere"
    assert coco_instances.kind_of([RotationSymmetry(Z, ORIGIN, 3)]) == "none"


def test_scenes_are_held_out_by_seed_but_never_all():
    names = [f"scene_{number:04d}" for number in range(20)]
    assert len(held_out_scenes(names, 0.1, 0)) == 2
    assert held_out_scenes(names, 0.1, 0) == held_out_scenes(names[::-1], 0.1, 0)
    assert len(held_out_scenes(names, 1.0, 0)) == 19
    assert held_out_scenes(names[:1], 0.5, 0) == set()
    assert held_out_scenes(names, 0.0, 0) == set()
    assert len(held_out_scenes(names, 0.001, 0)) == 1


def test_the_frames_of_a_scenes_two_cameras_are_in_one_file():
    items = []
    for number in range(12):
        for camera in ("kinect", "realsense"):
            scene = SceneFiles(Path(f"scenes/scene_{number:04d}"), number, camera)
            stamp = make_stamp("x", {})
            items.append(WorkItem(scene.name, Path(scene.name), stamp, (scene,)))
    for seed in range(10):
        splits = export_coco._splits(items, Path("out"), ExportCocoConfig(val_fraction=0.3), seed)
        sides = [{each.arguments[0].scene_id for each in split.arguments} for split in splits]
        assert sides[0].isdisjoint(sides[1])
        assert len(sides[0]) + len(sides[1]) == 12
