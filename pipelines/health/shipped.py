"""Whether the default weights are those that were shipped."""

from pathlib import Path

from pipelines.errors import SymgraspError
from pipelines.health.checks import Check, Status
from pipelines.inference import models
from pipelines.storage.provenance import digest
from pipelines.storage.weights_manifest import Manifest, manifest_path, read_manifest


def manifest_check(folder: Path = models.WEIGHTS) -> tuple[Manifest | None, Check]:
    """Return the manifest of the weights, None if it cannot be read, and what is found of it."""
    path = manifest_path(folder)
    try:
        manifest = read_manifest(path)
    except (SymgraspError, OSError) as error:
        return None, Check("manifest", Status.FAIL, str(error))
    return manifest, Check("manifest", Status.OK, f"{len(manifest.files)} files named in {path}")


def file_check(name: str, expected: str, folder: Path = models.WEIGHTS) -> Check:
    """Say whether a shipped file is what it was when it was shipped."""
    path, title = folder / name, f"weights {Path(name).stem}"
    if not path.is_file():
        return Check(title, Status.FAIL, f"{path} does not exist; install symgrasp again")
    found = digest(path)
    if found != expected:
        other = f"{path} is {found}, shipped was {expected}; install symgrasp again"
        return Check(title, Status.FAIL, other)
    return Check(title, Status.OK, f"{found} as shipped")
