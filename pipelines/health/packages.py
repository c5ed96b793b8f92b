"""Checks that required packages are installed, new enough, and can be loaded."""

import platform
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib import import_module, metadata
from itertools import groupby
from pathlib import Path

from packaging import requirements
from packaging.utils import canonicalize_name
from packaging.version import Version

from pipelines.health.checks import Check, Status

PROJECT = "symgrasp"
DEVELOPMENT = "dev"  # the extra for developers of the project
EXTRA = re.compile(r"extra == \"(?P<name>[\w-]+)\"")  # in a marker
# Errors of a torchvision whose operators were built for another torch.
FOREIGN_OPERATORS = re.compile(r"operator torchvision::\w+ does not exist|torchvision has CUDA")


@dataclass(frozen=True)
class Requirement:
    """A package that the project requires, its least version, and the extra that needs it."""

    name: str
    least: str
    extra: str

    @classmethod
    def parse(cls, text: str) -> "Requirement | None":
        """Read a line of the project's metadata, `h5py>=3.10` or `ray>=2.30; extra == "ray"`.

        None if the line is for other machines, as `embreex>=2; platform_machine != "aarch64"`.
        """
        line = requirements.Requirement(text)
        found = EXTRA.search(str(line.marker))
        extra = found["name"] if found else ""
        if line.marker and not line.marker.evaluate({"extra": extra}):
            return None
        least = next((each.version for each in line.specifier if each.operator == ">="), "0")
        return cls(line.name, least, extra)


def required() -> list[Requirement]:
    """Return the requirements of the installed project, without those for developers."""
    try:
        texts = metadata.requires(PROJECT) or []
    except metadata.PackageNotFoundError:  # `project_check` reports it
        texts = []
    found = map(Requirement.parse, texts)
    return [each for each in found if each is not None and each.extra != DEVELOPMENT]


def python_check() -> Check:
    """Report the version and platform of Python."""
    where = f"{platform.python_implementation()}, {platform.system()} {platform.machine()}"
    return Check("python", Status.OK, f"{platform.python_version()}, {where}")


def project_check() -> Check:
    """Report the project's version and folder."""
    where = import_module("pipelines").__path__[0]
    try:
        return Check(PROJECT, Status.OK, f"{metadata.version(PROJECT)} in {where}")
    except metadata.PackageNotFoundError:
        text = f"runs from {where} but is not installed, so its requirements are unknown"
        return Check(PROJECT, Status.FAIL, f"{text}; run: pip install {Path(where).parent}")


def package_check(needed: Requirement) -> Check:
    """Check that a required package is installed, new enough, and can be loaded."""
    install = f"run: pip install '{needed.name}>={needed.least}'"
    version = _version(needed.name)
    if version is None:
        return Check(needed.name, Status.FAIL, f"not installed; {install}")
    if Version(version) < Version(needed.least):
        return Check(needed.name, Status.FAIL, f"{version} is older than {needed.least}; {install}")
    for module in _modules(needed.name):
        try:
            import_module(module)
        except Exception as error:
            return Check(needed.name, Status.FAIL, _why(needed.name, version, error))
    return Check(needed.name, Status.OK, version)


def extra_checks(needed: list[Requirement]) -> Iterator[Check]:
    """Report which optional packages are installed; none is required."""
    for extra, packages in groupby(needed, key=lambda each: each.extra):
        install = f'if needed: pip install "{PROJECT}[{extra}]"'
        found = {each.name: _version(each.name) for each in packages}
        text = ", ".join(f"{name} {version or 'is missing'}" for name, version in found.items())
        yield Check(
            f"extra {extra}", Status.OK, text if all(found.values()) else f"{text}; {install}"
        )


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


@cache
def _modules_of_packages() -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for module, packages in metadata.packages_distributions().items():
        for package in packages:
            found.setdefault(canonicalize_name(package), []).append(module)
    return found


def _modules(package: str) -> list[str]:
    """Return the modules of a package to load: the one of the same name, else all public ones."""
    name = canonicalize_name(package)
    modules = _modules_of_packages().get(name, [])
    namesake = [module for module in modules if canonicalize_name(module) == name]
    return namesake or sorted(module for module in modules if not module.startswith("_"))


def foreign_torchvision(error: Exception) -> str | None:
    """Return a sentence if `error` shows a torchvision built for another torch, else None."""
    sentence = " ".join(str(error).split())
    if not FOREIGN_OPERATORS.search(sentence):
        return None
    return (
        f"{_version('torchvision')} was built for another torch than {_version('torch')} "
        f"({sentence}); install both from one place: "
        "pip install --force-reinstall torch torchvision"
    )


def _why(name: str, version: str, error: Exception) -> str:
    sentence = " ".join(str(error).split())
    foreign = foreign_torchvision(error) if name == "torchvision" else None
    if foreign is not None:
        return foreign
    is_of_system = "cannot open shared object file" in sentence  # libgomp or libGL is missing
    cure = "this library with the system's package manager" if is_of_system else "it again"
    return f"{version} does not load ({type(error).__name__}: {sentence}); install {cure}"
