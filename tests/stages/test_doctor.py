"""Stage `doctor`: one line for each check, and exit code 1 if a check fails."""

import json
import shutil

import pytest
from typer.testing import CliRunner

from pipelines import doctor, infer
from pipelines.configs import DoctorConfig, InferConfig
from pipelines.health import golden, packages
from pipelines.health.checks import Check, Status
from pipelines.inference import models
from pipelines.runtime.batch import BatchOptions
from pipelines.storage.weights_manifest import MADE_BY, manifest_path, read_manifest
from symgrasp_cli.app import app
from tests.grasp_files.whole_file import read_whole
from tools import golden_frame

STALE = f"the manifest of the default weights is not of these weights: run `{MADE_BY}`"


def test_this_machine_passes_and_every_check_is_listed():
    result = CliRunner().invoke(app, ["doctor", "--json"])
    content = json.loads(result.stdout)
    assert content["command"] == "doctor"  # as in the reports of all commands
    wrong = [check for check in content["checks"] if check["status"] == "FAIL"]
    assert not wrong, f"{wrong}; if grasps were changed on purpose, run `{MADE_BY}`"
    assert (result.exit_code, content["ok"]) == (0, True)
    names = [check["name"] for check in content["checks"]]
    assert len(set(names)) == len(names)
    assert {"python", "symgrasp", "torch", "torchvision", "numpy", "h5py", "cores", "memory"} < {
        *names
    }
    shipped_weights = sorted(path.stem for path in models.WEIGHTS.glob("*.safetensors"))
    assert "plane_critic" in shipped_weights
    last = ["manifest", *(f"weights {stem}" for stem in shipped_weights), "golden frame"]
    assert [name for name in names if "cuda" not in name][-len(last) :] == last


def with_a_broken(name, monkeypatch):
    def check(needed):
        status = Status.FAIL if needed.name == name else Status.OK
        return Check(needed.name, status, "looked at")

    monkeypatch.setattr(packages, "package_check", check)
    return list(doctor.run(DoctorConfig()))


@pytest.mark.parametrize("broken", ["torchvision", "scipy"])
def test_a_broken_package_fails_only_the_checks_that_need_it(monkeypatch, broken):
    checks = with_a_broken(broken, monkeypatch)
    assert doctor.exit_code(checks) == 1
    names = {check.name for check in checks}
    assert {"python", "numpy", "memory", "disk", "cores"} < names
    assert ("operators" in names) == (broken == "scipy")
    assert checks[-1].text == f"not checked: {broken} must be fixed first"


def test_a_check_that_breaks_gives_one_line_and_the_rest_goes_on(monkeypatch):
    def broken(*arguments):
        raise ZeroDivisionError("a\nb")

    monkeypatch.setattr(golden, "golden_check", broken)
    monkeypatch.setattr(doctor.machine, "cores_check", broken)
    checks = {check.name: check for check in with_a_broken(None, monkeypatch)}
    for name in ("cores", "golden frame"):
        assert checks[name] == Check(name, Status.FAIL, "ZeroDivisionError: a b")
    assert checks["weights network"].status is Status.OK


def test_weights_other_than_the_shipped_ones_are_reported(tmp_path):
    (tmp_path / "a.safetensors").write_bytes(b"other")
    check = golden.file_check("a.safetensors", "sha256:0", tmp_path)
    assert check.status is Status.FAIL
    assert "shipped was sha256:0" in check.text
    assert "does not exist" in golden.file_check("b", "sha256:0", tmp_path).text


def test_a_lost_manifest_fails_with_one_sentence(tmp_path):
    manifest, check = golden.manifest_check(tmp_path)
    assert manifest is None
    assert check.status is Status.FAIL
    assert "manifest.json does not exist" in check.text


def test_the_manifest_equals_the_output_of_its_command(tmp_path):
    golden_frame.main(tmp_path)
    made, kept = (read_manifest(manifest_path(f)) for f in (tmp_path, models.WEIGHTS))
    assert (kept.files, kept.frame) == (made.files, made.frame), STALE
    config = DoctorConfig()
    assert len(kept.grasps) > 4
    least = config.min_agreeing * len(kept.grasps)
    assert golden.agree(made.grasps, kept.grasps, config).sum() >= least, STALE


def test_the_golden_grasps_equal_the_grasps_of_infer(tmp_path):
    kept = read_manifest(manifest_path(models.WEIGHTS))
    for path in golden.FRAMES.glob(f"{kept.frame}_*"):
        (tmp_path / "frames").mkdir(exist_ok=True)
        shutil.copy(path, tmp_path / "frames")
    paths = infer.InferPaths(tmp_path / "frames", tmp_path / "g.h5")
    infer.run(paths, InferConfig(), BatchOptions(progress=False), device="cpu")
    (result,) = read_whole(tmp_path / "g.h5").results
    best = golden.best_grasps(golden.golden_result(kept.frame))
    found = golden.best_grasps(result)
    assert golden.agree(found, best, DoctorConfig()).all()
    assert len(found) == len(best)
