"""Packages: the names in the project, the installed versions, and their imports."""

import os
import subprocess
import sys
import tomllib
from importlib import metadata, util
from pathlib import Path

import pytest
from packaging import requirements

from pipelines.health import packages
from pipelines.health.checks import Status
from pipelines.health.packages import Requirement, extra_checks, package_check

ROOT = Path(__file__).resolve().parents[2]


def test_all_packages_that_pyproject_names_are_checked():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    needed = {Requirement.parse(text) for text in project["dependencies"]} - {None}
    assert needed <= set(packages.required())
    assert {each.extra for each in packages.required()} == {
        "",
        *project["optional-dependencies"],
    } - {"dev"}


@pytest.mark.parametrize(
    ("text", "requirement"),
    [
        ("h5py>=3.10", Requirement("h5py", "3.10", "")),
        ('dask[distributed]>=2024.5; extra == "dask"', Requirement("dask", "2024.5", "dask")),
        ("python-fcl>=0.7.0.6", Requirement("python-fcl", "0.7.0.6", "")),
        ("typer", Requirement("typer", "0", "")),
        ('a>=1; platform_machine != "of none"', Requirement("a", "1", "")),
        ('a>=1; platform_machine == "of none"', None),
        ('a>=1; python_version > "3" and extra == "ray"', Requirement("a", "1", "ray")),
    ],
)
def test_requirements_are_read_in_the_form_of_metadata(text, requirement):
    assert Requirement.parse(text) == requirement


def test_a_package_that_is_too_old_or_missing_is_reported_with_the_command_to_run():
    check = package_check(Requirement("numpy", "999.1", ""))
    assert check.status is Status.FAIL
    assert "is older than 999.1; run: pip install 'numpy>=999.1'" in check.text
    check = package_check(Requirement("no-such-package", "1", ""))
    assert (check.status, "not installed" in check.text) == (Status.FAIL, True)


def test_versions_are_compared_as_numbers_not_as_text(monkeypatch):
    monkeypatch.setattr(metadata, "version", lambda name: "2.13.0+cpu")
    assert package_check(Requirement("numpy", "2.9", "")).status is Status.OK


def test_a_package_that_does_not_load_fails_with_its_reason(monkeypatch):
    def broken(module):
        raise OSError("libGL.so.1: cannot open\nshared object file")

    monkeypatch.setattr(packages, "import_module", broken)
    check = package_check(Requirement("numpy", "1", ""))
    assert check.status is Status.FAIL
    assert "does not load (OSError: libGL.so.1: cannot open shared object file)" in check.text
    assert check.text.endswith("; install this library with the system's package manager")


def test_modules_are_found_whose_names_differ_from_their_package():
    assert packages._modules("opencv-python-headless") == ["cv2"]
    assert packages._modules("python-fcl") == ["fcl"]
    assert packages._modules("torch") == ["torch"]


def test_extras_get_one_line_each_and_never_fail():
    needed = [Requirement(name, "1", "ray") for name in ("numpy", "nothing-such")]
    (check,) = extra_checks(needed)
    assert (check.name, check.status) == ("extra ray", Status.OK)
    assert "nothing-such is missing" in check.text
    assert 'pip install "symgrasp[ray]"' in check.text
    (check,) = extra_checks(needed[:1])
    assert check.text == f"numpy {metadata.version('numpy')}"


def test_embree_is_required_where_it_has_a_wheel():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (line,) = [text for text in project["dependencies"] if text.startswith("embreex")]
    marker = requirements.Requirement(line).marker
    machines = {"x86_64": True, "AMD64": True, "arm64": True, "aarch64": False, "ARM64": False}
    for machine, needed in machines.items():
        assert marker.evaluate({"platform_machine": machine}) is needed


def test_a_project_that_is_not_installed_is_reported_in_one_sentence(monkeypatch):
    monkeypatch.setattr(packages, "PROJECT", "no-such-project")
    assert packages.required() == []
    check = packages.project_check()
    assert check.status is Status.FAIL
    assert "is not installed" in check.text
    assert str(ROOT) in check.text


def test_a_torchvision_of_another_torch_is_reported_with_the_command_to_run(tmp_path):
    # A torchvision of another build lacks the names that its compiled operators register.
    installed = Path(util.find_spec("torchvision").origin).parent
    (tmp_path / "torchvision").mkdir()
    for path in installed.iterdir():
        if path.suffix not in {".so", ".pyd", ".dylib"}:
            (tmp_path / "torchvision" / path.name).symlink_to(path)
    code = (
        "from pipelines.health.packages import *;"
        "check = package_check(Requirement('torchvision', '0.25', ''));"
        "print(check.status, check.text)"
    )
    paths = os.pathsep.join([str(tmp_path), str(ROOT)])
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"PYTHONPATH": paths},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert done.startswith("FAIL ")
    assert "operator torchvision::nms does not exist" in done
    assert "built for another torch than" in done
    assert "pip install --force-reinstall torch torchvision" in done
