"""The script of the paper's tables calls commands with existing options, in order."""

import os
import shlex
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from typer.main import get_command

from benchmarks import ablations
from pipelines.evaluation.reports.reports import read_table
from pipelines.evaluation.rows import KNOWN_ROWS, SELECTED
from symgrasp_cli.app import app
from tools import controls, row_costs

SCRIPT = Path(__file__).parents[2] / "tools" / "make_tables.sh"
GROUP = get_command(app)
TRAINED = ("multi-grasp", "gg-cnn", "pointnetgpd", "graspnet", "symmetrynet", "as-printed")


def calls(tmp_path, *arguments):
    """Return the command lines of a run whose commands do nothing."""
    log, stand_in = tmp_path / "calls.txt", tmp_path / "symgrasp"
    stand_in.write_text(f'#!/bin/sh\nprintf "%s\\n" "$*" >> {log}\n', encoding="utf-8")
    stand_in.chmod(0o755)
    environment = {**os.environ, "SYMGRASP": str(stand_in), "PYTHON": str(stand_in)}
    subprocess.run(
        ["sh", SCRIPT, tmp_path / "out", *arguments],
        env=environment,
        check=True,
        capture_output=True,
    )
    found = [shlex.split(line) for line in log.read_text(encoding="utf-8").splitlines()]
    return [call for call in found if call[0] != "-m"], [call for call in found if call[0] == "-m"]


@pytest.mark.parametrize("size", ["full", "tiny"])
def test_every_step_is_a_command_with_existing_options(size, tmp_path):
    commands, tools = calls(tmp_path, size)
    for name, *arguments in commands:
        parameters = GROUP.commands[name].params
        known = {option for each in parameters for option in (*each.opts, *each.secondary_opts)}
        assert {each for each in arguments if each.startswith("--")} <= known, name
    assert {call[1] for call in tools} == {
        "tools.controls",
        "benchmarks.ablations",
        "tools.row_costs",
    }
    (rest,) = (call[2:] for call in tools if call[1] == "benchmarks.ablations")
    ablations.parsed(rest)


def test_table_iv_can_be_left_out(tmp_path, monkeypatch):
    monkeypatch.setenv("TABLE_IV", "no")
    commands, tools = calls(tmp_path, "full")
    assert "benchmarks.ablations" not in {call[1] for call in tools}
    (evaluate,) = (call for call in commands if call[0] == "evaluate")
    assert evaluate.count("--table") == 1


def test_given_forms_of_table_iv_are_used(tmp_path):
    folder = tmp_path / "out"
    folder.mkdir()
    shipped = sorted((SCRIPT.parents[1] / "training").glob("table-iv*.json"))
    given = [shutil.copy(each, folder / each.name) for each in shipped]
    assert [each.name for each in given] == ["table-iv-by-default.json", "table-iv.json"]
    assert len({read_table(each)["title"] for each in given}) == 2
    commands, tools = calls(tmp_path, "full")
    assert "benchmarks.ablations" not in {call[1] for call in tools}
    (evaluate,) = (call for call in commands if call[0] == "evaluate")
    assert evaluate[-4:] == ["--table", str(given[0]), "--table", str(given[1])]


def test_each_row_is_inferred_evaluated_simulated_and_known_to_the_tables(tmp_path):
    commands, _ = calls(tmp_path, "tiny")
    made = {call[call.index("--out") + 1] for call in commands if call[0] == "infer"}
    tried = {call[1]: call[call.index("--out") + 1] for call in commands if call[0] == "simulate"}
    (call,) = (each for each in commands if each[0] == "evaluate")
    read = {call[k + 1] for k, word in enumerate(call) if word == "--with"} | {call[1]}
    assert read == made == set(tried)
    given = [call[k + 1] for k, word in enumerate(call) if word == "--success"]
    assert sorted(given) == sorted(tried.values())
    known = {row.name for row in KNOWN_ROWS}
    assert {Path(path).stem.removesuffix(SELECTED) for path in made} <= known


@pytest.mark.parametrize("is_later", [False, True])
def test_a_report_is_removed_when_a_row_is_newer(is_later, tmp_path):
    row, report = tmp_path / "out/rows/ours.h5", tmp_path / "out/report.json"
    row.parent.mkdir(parents=True)
    for path in (row, report):
        path.touch()
        os.utime(path, (100.0, 100.0))
    os.utime(row.parent, (100.0, 100.0))
    if is_later:
        os.utime(row, (200.0, 200.0))
    calls(tmp_path, "full")
    assert report.exists() is not is_later


def test_given_weights_and_a_given_dataset_are_not_made_again(tmp_path):
    weights = tmp_path / "out" / "weights"
    weights.mkdir(parents=True)
    for name in TRAINED:
        (weights / f"{name}.safetensors").touch()
    commands, _ = calls(tmp_path, "full", "ROOT")
    assert {call[0] for call in commands} == {"infer", "simulate", "evaluate"}
    assert all("ROOT" in call for call in commands)


@pytest.mark.parametrize("missing", TRAINED)
def test_only_weights_that_are_not_given_are_trained(missing, tmp_path):
    weights = tmp_path / "out" / "weights"
    weights.mkdir(parents=True)
    for name in TRAINED:
        (weights / f"{name}.safetensors").touch()
    # Weights with a checkpoint were begun here: their command decides whether to go on.
    (weights / f"{missing}.checkpoint.safetensors").touch()
    commands, _ = calls(tmp_path, "full", "ROOT")
    trained = [call for call in commands if call[0] in ("train", "train-baseline")]
    assert [Path(call[call.index("--out") + 1]).stem for call in trained] == [missing]


def test_costs_cover_the_networks_that_a_row_names(tmp_path):
    from pipelines.configs import NetworkConfig
    from pipelines.configs.peers import PeerNetworkConfig
    from pipelines.grasp_files import grasps_file
    from pipelines.inference.models import AXIS_CRITIC_WEIGHTS, NETWORK_WEIGHTS
    from pipelines.network.model import SymmetryGraspNet
    from pipelines.network.peers.ggcnn import GGCNN
    from pipelines.storage.checkpoints import save_weights
    from pipelines.storage.provenance import digest, make_stamp
    from tests.stages.toy_root import frame_names, true_result, write_root

    for folder in ("weights", "rows"):
        (tmp_path / folder).mkdir()
    own = tmp_path / "weights" / "gg-cnn.safetensors"
    save_weights(own, GGCNN(PeerNetworkConfig()).state_dict(), {"steps": "4154"})
    frame = replace(true_result(write_root(tmp_path / "root"), frame_names()[0]), seconds=0.25)
    stamp = make_stamp("infer", {"gripper": "rg2"})
    rows = {
        "gg-cnn": {"detector": digest(AXIS_CRITIC_WEIGHTS), "peer": digest(own)},
        "ours": {"network": digest(NETWORK_WEIGHTS)},
        "planar": {},
        "gone": {"peer": "sha256:0000000000000000"},
    }
    for name, used in rows.items():
        grasps_file.write(tmp_path / "rows" / f"{name}.h5", [frame], stamp, used)
    table = row_costs.costs(sorted((tmp_path / "rows").glob("*.h5")), tmp_path / "weights")
    found = {row[0]: row[1:] for row in table.rows}
    assert found["GG-CNN, trained here"] == ["0.25", "62,420", f"{62_420 + 26_851:,}", "4,154", "-"]
    assert found["planar"] == ["0.25", "none", "none", "-", "-"]
    assert found["gone"] == ["0.25", "-", "-", "-", "-"]
    assert found["SymGrasp"][3:] == ["-", "-"]
    network = SymmetryGraspNet(NetworkConfig())
    learned = sum(each.numel() for each in network.parameters())
    assert found["SymGrasp"][:2] == ["0.25", f"{learned:,}"]


def test_the_networks_of_the_controls_give_different_predictions(tmp_path, monkeypatch):
    import torch

    from pipelines.inference import models

    points = torch.rand((1, 600, 3), generator=torch.Generator().manual_seed(0)) * 0.1
    points -= points.mean(1, keepdim=True)
    answers = {}
    for name in ("random_network", "constant_affordance"):
        path = tmp_path / f"{name}.safetensors"
        getattr(controls, name)(path)
        with torch.inference_mode():
            answers[name] = models.predictor(path, "cpu").network(points)
    with torch.inference_mode():
        default = models.predictor(models.NETWORK_WEIGHTS, "cpu").network(points)
    constant = answers["constant_affordance"]
    torch.testing.assert_close(
        constant.affordance, torch.full_like(constant.affordance, controls.AFFORDANCE)
    )
    torch.testing.assert_close(constant.existence, default.existence)
    assert not torch.allclose(answers["random_network"].existence, default.existence, atol=0.1)


def test_true_regions_are_numbered_in_the_pictures_that_infer_reads(tmp_path):
    from pipelines.frames.masks import read_masks
    from tests.stages.toy_root import write_root

    made = write_root(tmp_path / "root")
    frames = controls.true_regions(tmp_path / "regions", made.root)
    assert frames > 0
    name = next(iter(sorted((tmp_path / "regions").rglob("*_label.png"))))
    relative = str(name.relative_to(tmp_path / "regions")).removesuffix("_label.png")
    assert read_masks(tmp_path / "regions", relative, (240, 320)).max() >= 1
