"""The mesh files of a folder, and sentences about the files of other formats in it."""

from collections.abc import Sequence
from itertools import islice
from pathlib import Path

from pipelines.dataset.meshes import CONVERSION, MESH_SUFFIXES, UNREAD_SUFFIXES, warn_once
from pipelines.errors import SymgraspError, counted

MOST_FILES_NAMED, MOST_LOOKED_AT = 5, 200


def find_meshes(source: Path) -> list[Path]:
    """List the mesh files in the folder `source`, sorted by name; or `source` if it is a mesh.

    Raises:
        SymgraspError: the folder or file does not exist, or contains no mesh.
    """
    if not source.exists():
        raise SymgraspError(f"{source} does not exist; give a mesh, a folder of meshes or a root")
    if not source.is_dir():
        return [source]
    files = sorted(file for file in source.iterdir() if not file.name.startswith("."))
    meshes = [file for file in files if file.suffix.lower() in MESH_SUFFIXES]
    passed_over = _passed_over(files)
    if not meshes:
        kinds = ", ".join(MESH_SUFFIXES)
        found = "; ".join([f"{source} holds no meshes", *passed_over])
        raise SymgraspError(f"{found}; files ending in {kinds} are read")
    for sentence in passed_over:
        warn_once(source, sentence)
    return meshes


def _passed_over(files: Sequence[Path]) -> list[str]:
    """Return sentences about files of unread mesh formats, and about subfolders with meshes."""
    others = [file for file in files if file.suffix.lower() in UNREAD_SUFFIXES]
    folders = [file for file in files if file.is_dir() and _holds_meshes(file)]
    sentences = []
    if others:
        found = f"{counted(len(others), 'file')} of formats that are not read: {_some(others)}"
        sentences.append(f"{found}; {CONVERSION}")
    if folders:
        found = f"meshes of subfolders are not read: {_some(folders)}"
        sentences.append(f"{found}; give each by name")
    return sentences


def _holds_meshes(folder: Path) -> bool:
    suffixes = {file.suffix.lower() for file in islice(folder.iterdir(), MOST_LOOKED_AT)}
    return bool(suffixes & {*MESH_SUFFIXES, *UNREAD_SUFFIXES})


def _some(paths: Sequence[Path]) -> str:
    names = ", ".join(path.name for path in paths[:MOST_FILES_NAMED])
    rest = len(paths) - MOST_FILES_NAMED
    return names if rest <= 0 else f"{names} and {rest} more"
