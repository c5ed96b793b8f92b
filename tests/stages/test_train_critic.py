"""The train-critic stage on a box, a can and a ball: rows collected once, files for `infer`."""

import re
import shutil
from dataclasses import asdict, replace
from itertools import product

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from pipelines import train_critic
from pipelines.configs import InferConfig, TrainCriticConfig
from pipelines.dataset import convex_pieces, object_list
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.object_list import ObjectRecord
from pipelines.errors import FormatError, MissingInputError, SymgraspError, ValueRangeError
from pipelines.evaluation.truth import TruthReader
from pipelines.geometry.symmetry import REFLECTION_SLOTS, ROTATION_SLOT, SPHERE_SLOT
from pipelines.grasping.critics import critic_files
from pipelines.grasping.symmetries.axis_evidence import AXIS_FEATURES
from pipelines.inference import models
from pipelines.inference.observation import observe
from pipelines.inference.regions.predicted_regions import region_models
from pipelines.learning.critics import collecting, critic_rows
from pipelines.learning.critics.collecting import Collector, ModelPaths
from pipelines.learning.critics.critic_training import CriticTraining
from pipelines.learning.critics.kinds import CRITIC_KINDS, critic_kind
from pipelines.learning.critics.logistic import best_of_groups
from pipelines.learning.loop.faults import save_fault
from pipelines.learning.loop.runs import RunRequest
from pipelines.learning.speed.gradients import loss_seed
from pipelines.runtime.batch import BatchOptions, StageReport
from pipelines.storage.checkpoints import load_weights
from pipelines.storage.provenance import make_stamp, read_stamp
from pipelines.synthesis.objects.decomposition import hull_of_points
from symgrasp_cli.app import app
from tests.learning.stopped import stopped_after
from tests.stages.toy_root import write_root

CONFIG = TrainCriticConfig(
    frame_stride=2,
    max_grasps=16,
    epochs=3,
    decay_epochs=1.0,
    batch_size=64,
    infer=InferConfig(regions="geometric"),
)
REQUEST, QUIET = RunRequest(device="cpu", threads=1), BatchOptions(progress=False)


@pytest.fixture(scope="module")
def roots(tmp_path_factory):
    folder = tmp_path_factory.mktemp("roots")
    return [write_root(folder / name).root for name in ("learned", "held")]


def run(name, roots, output, config=CONFIG, request=REQUEST, **options):
    options.setdefault("held_out", roots[1:])
    return train_critic.run(
        CRITIC_KINDS[name], roots[:1], output, config, request, options=QUIET, **options
    )


@pytest.fixture(scope="module")
def outputs(roots, tmp_path_factory):
    folder = tmp_path_factory.mktemp("out")
    made = {name: folder / f"{name}.safetensors" for name in CRITIC_KINDS}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(models, "detector", None)  # geometric regions need none
        for name, path in made.items():
            assert run(name, roots, path).exit_code == 0
    return made


def rows_of(output, root="learned"):
    files = sorted((output.parent / f"{output.stem}.rows" / root).glob("*.h5"))
    assert len(files) == 2
    return critic_rows.read_known(files)


def with_rows_of(output, folder):
    """An output in `folder` with the rows of another output."""
    rows = folder / f"{output.stem}.rows"
    rows.symlink_to(output.with_name(rows.name))
    return folder / output.name


def test_a_critic_does_not_start_from_its_own_output(tmp_path):
    path = tmp_path / "axes.safetensors"
    path.touch()
    with pytest.raises(ValueRangeError, match=r"--init is .*; it must be another file than --out"):
        run("axes", [tmp_path, tmp_path], path, init=path)


def test_weights_that_a_critic_does_not_need_are_named(caplog, tmp_path):
    paths = ModelPaths(axis_critic=tmp_path / "a", plane_critic=tmp_path / "p")
    with pytest.raises(SymgraspError):
        run("planes", [tmp_path / "x", tmp_path / "y"], tmp_path / "c.safetensors", paths=paths)
    assert [each.message for each in caplog.records] == [
        f"{tmp_path / 'p'} is not used to train a critic of planes"
    ]


def test_the_files_are_critics_that_name_their_features(outputs):
    for name in CRITIC_KINDS:
        critic = critic_files.read_point_critic(outputs[name], CRITIC_KINDS[name].model)
        assert critic.weights["calibration"][1] > 0
        rows = rows_of(outputs[name])
        found = critic.probability(rows.points.astype(np.float32), rows.shared, rows.candidates)
        assert np.corrcoef(found, rows.truth)[0, 1] > 0.3
        _, metadata = load_weights(outputs[name])
        assert '"loss"' in metadata["validation"]


def test_damaged_rows_are_collected_again(roots, outputs, tmp_path):
    output = tmp_path / "axes.safetensors"
    shutil.copytree(outputs["axes"].with_name("axes.rows"), tmp_path / "axes.rows")
    damaged = next((tmp_path / "axes.rows/held").glob("*.h5"))
    whole = damaged.read_bytes()
    damaged.write_bytes(whole[:-100])
    assert run("axes", roots, output).done
    assert damaged.read_bytes() == whole


@pytest.mark.parametrize("name", CRITIC_KINDS)
def test_candidates_of_grasps_depend_on_the_surroundings(name, tmp_path):
    root = write_root(tmp_path / "root")

    def stamps():
        items = train_critic.row_items(root.root, tmp_path / "c", CRITIC_KINDS[name], CONFIG, 0, {})
        return [item.stamp for item in items]

    before = stamps()
    corners = np.array(list(product((0.5, 0.6), (0.0, 1.0), (0.0, 1.0))))
    convex_pieces.write(root.scenes()[0].surroundings_path, [hull_of_points(corners)])
    after = stamps()
    assert (after[0] != before[0]) == (name == "grasps")
    assert after[1:] == before[1:]


def test_the_can_has_a_true_axis_the_ball_a_true_sphere_and_the_box_true_planes(outputs):
    rows = rows_of(outputs["axes"])
    axes, spheres = (rows[rows.slot == slot] for slot in (ROTATION_SLOT, SPHERE_SLOT))
    # A box and a can in each of two frames; for a ball any axis is true.
    assert len(set(axes.group)) == 4
    best = best_of_groups(axes.truth.astype(float), axes.group)
    assert sorted(axes.truth[best]) == [0.0, 0.0, 1.0, 1.0]
    assert sorted(spheres.truth) == [0.0] * 4 + [1.0] * 2
    assert (spheres.shared[:, AXIS_FEATURES.index("is_sphere")] == 1.0).all()
    planes = rows_of(outputs["planes"])
    assert set(planes.slot) == {REFLECTION_SLOTS[0]}
    assert set(planes.truth) == {0.0, 1.0}


@pytest.mark.parametrize("name", ["axes", "planes"])
def test_candidates_have_the_sources_of_infer(name, roots):
    reader = TruthReader(GraspNetRoot(roots[0]), CONFIG.evaluate)
    files = reader.root.scenes()[0].frames()[0]

    def count(candidates):
        symmetry = replace(CONFIG.infer.selection.symmetry, candidates=candidates)
        selection = replace(CONFIG.infer.selection, symmetry=symmetry)
        config = replace(CONFIG, infer=replace(CONFIG.infer, selection=selection))
        collector = Collector(reader, ModelPaths(), config)
        groups = collector.rows(CRITIC_KINDS[name], files, np.random.default_rng(0))
        return sum(len(rows) for rows in groups)

    assert count("network") < count("network+shape")
    assert count("shape") < count("network+shape")


def test_candidates_are_of_the_regions_in_which_infer_seeks_grasps(roots, monkeypatch):
    reader = TruthReader(GraspNetRoot(roots[0]), CONFIG.evaluate)
    files = reader.root.scenes()[0].frames()[0]

    def count(**changed):
        def seen(*args, **kwargs):
            found = observe(*args, **kwargs)
            first, *others = found.regions
            return replace(found, regions=[replace(first, **changed), *others])

        monkeypatch.setattr(collecting, "observe", seen)
        return len(Collector(reader, ModelPaths(), CONFIG).observed(files).regions)

    every = count()
    assert count(source="color") == every
    assert count(source="color", status="flat") == every - 1
    limits = replace(CONFIG.infer.limits, box=(5.0, 5.0, 5.0, 6.0, 6.0, 6.0))
    away = replace(CONFIG, infer=replace(CONFIG.infer, limits=limits))
    monkeypatch.undo()
    assert not Collector(reader, ModelPaths(), away).observed(files).regions


def test_symmetries_are_fitted_as_in_infer(roots, monkeypatch):
    reader = TruthReader(GraspNetRoot(roots[0]), CONFIG.evaluate)
    files, given = reader.root.scenes()[0].frames()[0], []

    def noted(predicted, scene, config, critics):
        given.append(critics)
        return region_models(predicted, scene, config, critics)

    monkeypatch.setattr(collecting, "region_models", noted)
    for is_fitted in (True, False):
        symmetry = replace(CONFIG.infer.selection.symmetry, is_fitted=is_fitted)
        selection = replace(CONFIG.infer.selection, symmetry=symmetry)
        config = replace(CONFIG, infer=replace(CONFIG.infer, selection=selection))
        collector = Collector(reader, ModelPaths(), config)
        assert next(collector.rows(CRITIC_KINDS["grasps"], files, np.random.default_rng(0)))
    assert given[0] is not None
    assert given[1] is None


def test_grasps_open_by_the_checks_of_the_attempt_that_finds_them(roots):
    """A second attempt ignores unseen sides of other regions, which may fill all the space."""
    reader = TruthReader(GraspNetRoot(roots[0]), CONFIG.evaluate)
    collector = Collector(reader, ModelPaths(), CONFIG)
    frame = collector.observed(reader.root.scenes()[0].frames()[0])
    selection, critics = CONFIG.infer.selection, models.symmetry_critics()
    widened, axis = [], np.arange(-0.1, 0.1, 0.005)
    for model in region_models(frame.regions, frame.scene, selection, critics):
        block = model.cloud.middle + np.stack(np.meshgrid(axis, axis, axis), -1).reshape(-1, 3)
        hidden = replace(model, completion=replace(model.completion, others=block))
        for features, checks in collector._tried(hidden, frame.scene, np.random.default_rng(0)):
            opened = collector._opened(features, checks)
            widened += (opened.width > features.feasible.grasps.width).tolist()
    assert np.mean(widened) > 0.1


def test_grasps_have_the_quality_among_true_meshes(outputs):
    rows = rows_of(outputs["grasps"])
    assert rows.truth.max() > 0.9
    assert rows.truth.min() < 0.5
    assert max(np.bincount(rows.group)) <= CONFIG.max_grasps


def test_a_finished_critic_is_skipped_and_other_settings_are_refused(roots, outputs):
    for name, path in outputs.items():
        before = path.read_bytes()
        assert run(name, roots, path).skipped == [path.name]
        assert path.read_bytes() == before
    other = replace(CONFIG, infer=replace(CONFIG.infer, mirrored=True))
    words = re.escape("another config (infer.mirrored = false, now true) and other data")
    with pytest.raises(SymgraspError, match=words):
        run("axes", roots, outputs["axes"], other)
    with pytest.raises(SymgraspError, match="made with another config"):
        run("planes", roots, outputs["planes"], replace(CONFIG, epochs=4))


def test_rows_are_collected_once_and_more_epochs_use_them_again(
    roots, outputs, tmp_path, monkeypatch
):
    path = with_rows_of(outputs["planes"], tmp_path)
    monkeypatch.setattr(Collector, "rows", None)
    assert run("planes", roots, path, replace(CONFIG, epochs=1)).exit_code == 0


def test_two_workers_and_one_give_the_same_critic(roots, outputs, tmp_path):
    path = tmp_path / "axes.safetensors"
    options = BatchOptions(workers=2, progress=False)
    kind, held = CRITIC_KINDS["axes"], roots[1:]
    train_critic.run(kind, roots[:1], path, CONFIG, REQUEST, held_out=held, options=options)
    assert path.read_bytes() == outputs["axes"].read_bytes()


def test_a_stopped_training_resumes_as_if_it_had_never_stopped(roots, outputs, tmp_path):
    path = with_rows_of(outputs["grasps"], tmp_path)
    with stopped_after(2):
        run("grasps", roots, path)
    with pytest.raises(SymgraspError, match="--resume"):
        run("grasps", roots, path)
    run("grasps", roots, path, request=replace(REQUEST, resume=True))
    found, expected = (load_weights(each)[0] for each in (path, outputs["grasps"]))
    for name, tensor in expected.items():
        np.testing.assert_array_equal(found[name], tensor, err_msg=name)


def test_a_training_starts_from_the_weights_of_an_earlier_one(roots, outputs, tmp_path):
    path = with_rows_of(outputs["planes"], tmp_path)
    still = replace(CONFIG, epochs=1, learning_rate=1e-9)
    assert run("planes", roots, path, still, init=outputs["planes"]).exit_code == 0
    found, expected = (load_weights(each)[0] for each in (path, outputs["planes"]))
    for name, tensor in expected.items():
        np.testing.assert_allclose(found[name], tensor, rtol=1e-5, atol=1e-5, err_msg=name)
    with pytest.raises(SymgraspError, match="made with other data"):
        run("planes", roots, path, still)
    with pytest.raises(FormatError, match="holds AxisCritic"):
        run("planes", roots, tmp_path / "x.safetensors", init=outputs["axes"])


def test_earlier_critics_are_inputs_of_later_ones(roots, outputs, tmp_path):
    stamp = read_stamp(next((outputs["grasps"].with_name("grasps.rows") / "held").glob("*.h5")))
    assert {"detector", "network", "axis_critic", "plane_critic"} <= stamp["inputs"].keys()
    paths = replace(ModelPaths(), axis_critic=tmp_path / "none.safetensors")
    with pytest.raises(MissingInputError, match="symgrasp train-critic axes"):
        run("planes", roots, tmp_path / "x.safetensors", paths=paths)
    assert run("axes", roots, tmp_path / "x.safetensors", paths=paths).exit_code == 0


def test_weights_of_another_model_are_named_before_any_scene(roots, outputs, tmp_path):
    paths = replace(ModelPaths(), network=outputs["planes"])
    with pytest.raises(FormatError, match=r"planes\.safetensors"):
        run("planes", roots, tmp_path / "x.safetensors", paths=paths)
    assert not list(tmp_path.iterdir())


def test_wrong_roots_are_refused_in_a_sentence(roots, tmp_path):
    path = tmp_path / "x.safetensors"
    with pytest.raises(ValueRangeError, match="--calibrate is not given; it must be a dataset"):
        run("planes", roots, path, held_out=())
    with pytest.raises(ValueRangeError, match="folders of different names"):
        run("grasps", [roots[0], roots[0]], path)
    (tmp_path / "scenes").mkdir()
    with pytest.raises(SymgraspError, match="holds no scene"):
        run("axes", [tmp_path], path, held_out=roots[1:])
    records = [ObjectRecord(0, "o", "can", "wide_similar")]
    object_list.write(tmp_path / "objects.json", records, make_stamp("test", {}))
    for learned, held_out in (([tmp_path], roots[1:]), (roots[:1], [tmp_path])):
        with pytest.raises(SymgraspError, match="kept for evaluation"):
            run("planes", learned, path, held_out=held_out)
    with pytest.raises(ValueRangeError, match="safetensors"):
        run("axes", roots, tmp_path / "x.bin")
    with pytest.raises(SymgraspError, match="critic 'hands'"):
        critic_kind("hands")


def test_objects_that_are_both_trained_and_calibrated_on_are_named(
    roots, tmp_path, caplog, monkeypatch
):
    faulty = StageReport("collecting", failed={"scene": "it ends here"})
    monkeypatch.setattr(train_critic, "run_batch", lambda *_: faulty)
    run("axes", roots, tmp_path / "axes.safetensors")
    held = shutil.copytree(roots[1], tmp_path / "held")
    for path in held.glob("models/*/nontextured.ply"):
        path.write_bytes(path.read_bytes() + b"\n")
    run("axes", [roots[0], held], tmp_path / "axes.safetensors")
    (message,) = (each.getMessage() for each in caplog.records)
    assert message.startswith(f"objects of {roots[1]} are trained on too (3 of 3): ")


def test_a_faulty_scene_fails_alone_and_no_critic_is_written(roots, tmp_path):
    broken = write_root(tmp_path / "learned")
    scene = broken.scenes()[0]
    min(scene.camera_folder.glob("depth/*.png")).write_bytes(b"no picture")
    path = tmp_path / "axes.safetensors"
    report = run("axes", [broken.root], path, held_out=roots[1:])
    assert [*report.failed] == [f"learned/{scene.name}"]
    assert not path.exists()


def test_a_saved_batch_gives_the_same_loss_again(outputs, tmp_path):
    rows = rows_of(outputs["grasps"])
    trainee = CriticTraining(CRITIC_KINDS["grasps"], rows, rows, CONFIG)
    batch = trainee.load([np.arange(20)], [np.random.default_rng(0)])
    place, path = (0, 1, 2, 0), tmp_path / "fault.safetensors"
    stamp = make_stamp("train-critic", {"kind": "grasps", **asdict(CONFIG)})
    save_fault(path, trainee.module, trainee.tensors(batch), place, stamp)
    drawing = torch.Generator().manual_seed(loss_seed(*place))
    expected = trainee.loss(trainee.module, batch, drawing)
    found = train_critic.replay(path)
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        assert found[name] == pytest.approx(float(value.detach()), rel=1e-5)


def test_the_command_writes_files_that_infer_opens(roots, outputs, tmp_path):
    path = tmp_path / "axes.safetensors"
    options = ["--frame-stride", "2", "--set", "infer.regions=geometric", "--set", "max_grasps=16"]
    options += ["--epochs", "3", "--decay-epochs", "1", "--batch-size", "64", "--workers", "1"]
    options += ["--calibrate", str(roots[1])]
    call = ["train-critic", "axes", str(roots[0]), "--out", str(path), *options]
    result = CliRunner().invoke(app, call)
    assert result.exit_code == 0, result.output
    assert "--axis-critic" in result.output
    assert path.read_bytes() == outputs["axes"].read_bytes()
    call[1] = "hands"
    wrong = CliRunner().invoke(app, call)
    assert wrong.exit_code == 2
