"""Stamps in every output: how it was made, and whether it is still up to date."""

import dataclasses
import hashlib
import html
import json
import logging
import re
from collections.abc import Iterable, Mapping
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any

import h5py

from pipelines.contents import json_object
from pipelines.errors import FormatError, StaleOutputError, SymgraspError, ValueRangeError
from pipelines.storage.files import (
    make_folder,
    open_safetensors,
    read_json,
    real_path,
    refuse_folder_as_file,
    remove_file,
    write_json,
)
from pipelines.storage.h5_columns import attribute
from pipelines.storage.h5_files import open_h5

log = logging.getLogger(__name__)
# Fields that must agree for an existing output to be reused; the version is not compared.
COMPARED = ("stage", "config", "seed", "inputs")
MISSING = "missing"  # in place of the digest of a file that does not exist
PAGE_STAMP = re.compile('<meta name="provenance" content="([^"]*)">')
PAGE_HEAD = 65536  # first characters of a page, which must contain its stamp


@dataclasses.dataclass(frozen=True)
class Stamp:
    """Origin of an output: stage, settings, seed and digests of its inputs.

    `recorded`: further facts for later stages, written if there are any, and not compared.
    """

    stage: str
    config: Mapping[str, Any]
    seed: int = 0
    inputs: Mapping[str, str] = dataclasses.field(default_factory=dict)
    recorded: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """Return the stamp as a JSON object, the toolkit's version included."""
        return {
            "stage": self.stage,
            "config": dict(self.config),
            "seed": self.seed,
            "inputs": dict(self.inputs),
            "version": version(),
        } | ({"recorded": dict(self.recorded)} if self.recorded else {})

    def as_text(self) -> str:
        """Return the stamp as one line of JSON."""
        return json.dumps(self.as_json(), sort_keys=True)

    def as_digest(self) -> str:
        """Return a digest of the compared fields, the same for every version of the toolkit."""
        stamp = self.as_json()
        return digest_text(json.dumps({key: stamp[key] for key in COMPARED}, sort_keys=True))


@lru_cache(maxsize=1)
def version() -> str:
    """Return the installed version of symgrasp."""
    try:
        return metadata.version("symgrasp")
    except metadata.PackageNotFoundError:
        return "unknown"


def make_stamp(
    stage: str,
    config: Any,  # noqa: ANN401 - any dataclass, or a mapping
    *,
    seed: int = 0,
    inputs: Mapping[str, str] | None = None,
) -> Stamp:
    """Return the stamp of `stage` run with `config`, a dataclass or a mapping.

    JSON has no infinity: it is stored as the text `inf`.
    """
    settings = config if isinstance(config, Mapping) else dataclasses.asdict(config)
    # Through JSON and back, so that tuples and lists compare as they will when read again.
    text = json.dumps(settings, default=str)
    stored = json.loads(text, parse_constant=lambda name: name.replace("Infinity", "inf"))
    return Stamp(stage, stored, seed, dict(inputs or {}))


def digest(path: Path) -> str:
    """Return the first 16 hexadecimal digits of the file's SHA-256.

    A pipe or a device may never end and is not read here; its reader raises the error.
    """
    if path.exists() and not path.is_file():
        return "no plain file"
    with path.open("rb") as stream:
        return "sha256:" + hashlib.file_digest(stream, "sha256").hexdigest()[:16]


def digest_if_there(path: Path) -> str:
    """Return the digest of a file, or `missing` if there is no file, which its reader reports."""
    return digest(path) if path.is_file() else MISSING


def digest_text(text: str) -> str:
    """Return the first 16 hexadecimal digits of the SHA-256 of `text`."""
    return "sha256:" + hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest()[:16]


def digest_folder(folder: Path, pattern: str) -> str:
    """Return one digest of the names and contents of all files of `folder` that fit `pattern`.

    Hidden files are left over from interrupted runs, and do not count.
    """
    files = sorted(path for path in folder.glob(pattern) if not path.name.startswith("."))
    return digest_text("".join(f"{path.name} {digest(path)}\n" for path in files))


def digest_tree(folder: Path, suffixes: tuple[str, ...]) -> str:
    """Return one digest of the names and contents of all files of `suffixes` below `folder`."""
    files = sorted(path for path in folder.rglob("*") if path.suffix in suffixes)
    lines = (f"{p.relative_to(folder).as_posix()} {digest(p)}" for p in files if p.is_file())
    return digest_text("".join(lines))


def sidecar_of(target: Path) -> Path:
    """Return the path of the stamp of `target`, for formats that have no place for a stamp."""
    if target.is_dir():
        return target / "provenance.json"
    return target.with_name(f"{target.name}.provenance.json")


def write_sidecar(target: Path, stamp: Stamp) -> None:
    """Write the stamp of `target` next to the file, or into the folder if it is a folder."""
    write_json(sidecar_of(target), stamp.as_json())


def stamp_ahead(target: Path, stamp: Stamp) -> None:
    """Write the sidecar of the file `target`, which is to be written next.

    The stamp is written first: a file without a stamp counts as another program's. An earlier
    `target` is removed before: a run killed in between would leave it under the wrong stamp.
    """
    remove_file(target)
    make_folder(target.parent)
    write_sidecar(target, stamp)


def remove_stamped(target: Path) -> None:
    """Remove the file `target`, if it exists, and its sidecar."""
    remove_file(target)
    remove_file(sidecar_of(target))


def refuse_other_suffix(output: Path, suffix: str) -> None:
    """Raise ValueRangeError if the file `--out` does not end in `suffix`.

    The place of an output's stamp follows from the suffix; with another suffix the stamp would not
    be found again.

    Raises:
        SymgraspError: `output` is a folder.
    """
    refuse_folder_as_file(output)
    if output.suffix != suffix:
        raise ValueRangeError("--out", output, f"a file name that ends in {suffix}")


def refuse_own_input(output: Path, inputs: Iterable[Path]) -> None:
    """Raise ValueRangeError if `--out` is one of `inputs`, which --overwrite would destroy."""
    if real_path(output) in {real_path(each) for each in inputs}:
        raise ValueRangeError("--out", output, "another file than the files that are read")


def read_stamp(target: Path) -> dict[str, Any] | None:
    """Return the stamp of `target`, or None if it has none; a stamp is a JSON object."""
    is_bare_h5 = not target.suffix and target.is_file() and h5py.is_hdf5(target)
    # A folder's stamp is in the folder, whatever its name ends in.
    match ".h5" if is_bare_h5 else "" if target.is_dir() else target.suffix:
        case ".h5" | ".hdf5":
            with open_h5(target, root_attributes_only=True) as file:
                return _stamp_of(attribute(file, "provenance"))
        case ".json":
            # A file written by hand may have anything there, which is no stamp.
            content = read_json(target)
            stamp = content.get("provenance") if isinstance(content, dict) else None
            return stamp if isinstance(stamp, dict) else None
        case ".safetensors":
            with open_safetensors(target) as file:
                return _stamp_of((file.metadata() or {}).get("provenance"))
        case ".html" if not sidecar_of(target).exists():
            with target.open(encoding="utf-8", errors="replace") as stream:
                found = PAGE_STAMP.search(stream.read(PAGE_HEAD))
            return None if found is None else _stamp_of(html.unescape(found[1]))
        case _:
            sidecar = sidecar_of(target)
            content = read_json(sidecar) if sidecar.exists() else None
            return content if isinstance(content, dict) else None


def _stamp_of(text: object) -> dict[str, Any] | None:
    try:
        return json_object("", text, "the stamp")
    except FormatError:
        return None


def refuse_foreign(output: Path, stage: str) -> None:
    """Raise SymgraspError if `output` exists and was not written by `stage`, even to overwrite."""
    if not output.exists():
        return
    made_by = str((read_stamp(output) or {}).get("stage"))
    if made_by.partition(" ")[0] != stage:  # `evaluate --protocol graspnet` is `evaluate` too
        raise SymgraspError(f"{output} exists and is no output of {stage}; choose another output")


def is_finished(target: Path, stamp: Stamp, *, overwrite: bool = False) -> bool:
    """Return whether `target` exists and has the same compared fields as `stamp`.

    Raises:
        StaleOutputError: `target` exists with another stamp, and may not be overwritten.
    """
    if not target.exists() or overwrite:
        return False
    found, wanted = read_stamp(target) or {}, stamp.as_json()
    if any(found.get(key) != wanted[key] for key in COMPARED):
        raise StaleOutputError(target, _lost_inputs(found, stamp))
    warn_of_other_version(found, stamp)
    return True


def _lost_inputs(found: Mapping[str, Any], stamp: Stamp) -> list[str]:
    """Return the names of the inputs of the earlier stamp `found` that do not exist any more."""
    earlier = found.get("inputs")
    if not isinstance(earlier, Mapping):
        return []
    lost = [name for name, digested in stamp.inputs.items() if digested == MISSING]
    return [name for name in lost if earlier.get(name, MISSING) != MISSING]


def warn_of_other_version(found: Mapping[str, Any], stamp: Stamp) -> None:
    """Warn if the stamp `found` of a reused file is of another version than the new `stamp`."""
    made, installed = found.get("version"), stamp.as_json()["version"]
    if made != installed:
        _warn_of_version(str(made), str(installed))


@lru_cache  # once a process: a stage may reuse thousands of files
def _warn_of_version(found: str, installed: str) -> None:
    log.warning(
        "reused outputs were made by symgrasp %s, installed is %s; --overwrite makes them again",
        found,
        installed,
    )


@dataclasses.dataclass(frozen=True)
class FileVersion:
    """A file as last written: the key of a cache, which is valid for this version only."""

    path: Path
    written: int = 0  # nanoseconds; 0 if there is no such file, which its reader reports
    size: int = 0  # bytes

    @classmethod
    def of(cls, path: Path) -> "FileVersion":
        """Return the file `path` as it is now."""
        if not path.is_file():
            return cls(path)
        status = path.stat()
        return cls(path, status.st_mtime_ns, status.st_size)
