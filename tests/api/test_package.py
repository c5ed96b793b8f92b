"""The package when it is imported, and as the command line."""

import subprocess
import sys

import pytest

import symgrasp


def python(*arguments):
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False)


def test_importing_the_package_loads_no_slow_module():
    heavy = {"torch", "numpy", "numba", "cv2", "h5py", "scipy", "typer"}
    code = (
        "import sys, symgrasp; symgrasp.SymgraspError; "
        f"heavy = {heavy} & set(sys.modules); sys.exit(f'imported {{heavy}}' if heavy else 0)"
    )
    result = python("-c", code)
    assert result.returncode == 0, result.stderr


def test_files_are_read_and_names_imported_without_torch():
    code = (
        "import sys; from symgrasp import GraspDetector, Grasps, read_grasps; "
        "sys.exit('torch' in sys.modules)"
    )
    result = python("-c", code)
    assert result.returncode == 0, result.stderr


def test_every_public_name_can_be_imported_and_no_other():
    for name in symgrasp.__all__:
        assert getattr(symgrasp, name) is not None
    assert dir(symgrasp) == sorted(symgrasp.__all__)
    with pytest.raises(AttributeError, match="no attribute 'GraspFinder'"):
        _ = symgrasp.GraspFinder


def test_the_package_runs_the_command_line_too():
    result = python("-m", "symgrasp", "--version")
    assert result.stdout.split() == ["symgrasp", symgrasp.__version__]
