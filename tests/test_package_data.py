"""The wheel's files: pyproject.toml names all files that the package reads at run time."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
KEPT_BY_PYTHON = {".py", ".pyc", ".nbi", ".nbc"}


def test_every_data_file_of_the_package_is_shipped():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    for package, patterns in settings["tool"]["setuptools"]["package-data"].items():
        folder = ROOT / package
        shipped = {path for pattern in patterns for path in folder.glob(pattern)}
        there = {path for path in folder.rglob("*") if path.is_file()}
        left_out = {p for p in there - shipped if p.suffix not in KEPT_BY_PYTHON}
        assert not {str(path.relative_to(ROOT)) for path in left_out}
