"""Packages that the project needs: whether they are there, new enough, and load."""

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
DEVELOPMENT = "dev"  # the extra that only the project itself needs
EXTRA = re.compile(r"extra == \"(?P<name>[\w-]+)\"")  # of a marker
# What torchvision raises where its operators were built for another torch.
FOREIGN_OPERATORS = re.compile(r"operator torchvision::\w+ does not exist|torchvision has CUDA")


@dataclass(frozen=True)
class Requirement:
    """A package that the project names: at least which version, and for which extra."""

    name: str
    least: str
    extra: str

    @classmethod
    def parse(cls, text: str) -> "Requirement | None":
        """Read a line of the project's metadata, `h5py>=3.10` or `ray>=2.30; extra == "ray"`.

        None if it is not for this machine, as `embreex>=2; platform_machine != "aarch64"`.
        """
        line = requirements.Requirement(text)
        found = EXTRA.search(str(line.marker))
        extra = found["name"] if found else ""
        if line.marker and not line.marker.evaluate({"extra": extra}):
            return None
        least = next((each.version for each in line.specifier if each.operator == ">="), "0")
        return cls(line.name, least, extra)


def required() -> list[Requirement]:
    """Return what the installed project says it needs, the tools of its developers left out."""
    try:
        texts = metadata.requires(PROJECT) or []
    except metadata.PackageNotFoundError:  # `project_check` says so
        texts = []
    found = map(Requirement.parse, texts)
    return [each for each in found if each is not None and each.extra != DEVELOPMENT]


def python_check() -> Check:
    """Say which Python runs on what."""
    where = f"{platform.python_implementation()}, {platform.system()} {platform.machine()}"
    return Check("python", Status.OK, f"{platform.python_version()}, {where}")


def project_check() -> Check:
    """Say which version of the project runs, and from where."""
    where = import_module("pipelines").__path__[0]
    try:
        return Check(PROJECT, Status.OK, f"{metadata.version(PROJECT)} in {where}")
    except metadata.PackageNotFoundError:
        text = f"runs from {where} but is not installed, so what it needs is unknown"
        return Check(PROJECT, Status.FAIL, f"{text}; run: pip install {Path(where).parent}")


def package_check(needed: Requirement) -> Check:
    """Say whether a required package is there, new enough, and loads."""
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
    """Say which optional packages are there; none of them has to be."""
    for extra, packages in groupby(needed, key=lambda each: each.extra):
        install = f'where it is wanted: pip install "{PROJECT}[{extra}]"'
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
    """Return the modules to load of a package: its namesake, else all that are public."""
    name = canonicalize_name(package)
    modules = _modules_of_packages().get(name, [])
    namesake = [module for module in modules if canonicalize_name(module) == name]
    return namesake or sorted(module for module in modules if not module.startswith("_"))


def foreign_torchvision(error: Exception) -> str | None:
    """Return the sentence on `error` where torchvision was built for another torch, else None."""
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
    return f"{version} does not load ({type(error).__name__}: {sentence}); install it again"
