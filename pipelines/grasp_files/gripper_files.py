"""Gripper presets and users' own grippers, as TOML."""

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from pipelines.configs.toml_files import read_toml
from pipelines.contents import LONGEST_REASON, mapping_in, reading
from pipelines.errors import FormatError, SymgraspError, UnknownNameError
from pipelines.grasping.gripper import Gripper
from pipelines.storage.provenance import digest_text

GRIPPERS = Path(__file__).parent.parent / "grippers"


def preset_names() -> list[str]:
    """Return the names of the grippers that come with the toolkit."""
    return sorted(path.stem for path in GRIPPERS.glob("*.toml"))


def gripper_digest(name_or_path: str) -> str:
    """Return a digest of a gripper's measures, not of its name; errors as `load_gripper`."""
    return digest_text(repr(replace(load_gripper(name_or_path), name="")))


def gripper_to_use(wanted: str, used: str, stamp: Mapping[str, Any]) -> str:
    """Return the gripper that grasps are looked at with: the one `wanted`, else their own.

    Args:
        wanted: preset or TOML file; empty if none was named.
        used: the one that the grasps were found for.
        stamp: of the run that found them, as JSON.

    Raises:
        SymgraspError: it is not known; or none was named and theirs is gone, or is not what it was.
    """
    if wanted:
        load_gripper(wanted)
        return wanted
    if not Path(used).suffix or Path(used).is_file():
        found = mapping_in(stamp, "inputs").get("gripper")
        if found in (None, gripper_digest(used)):
            return used
        why = "has other measures now"
    else:
        why = "is not there any more, or not below this folder"
    raise SymgraspError(f"gripper {used}, which the grasps were found for, {why}; name a --gripper")


def load_gripper(name_or_path: str) -> Gripper:
    """Return the preset of that name, or the gripper of that TOML file.

    Raises:
        UnknownNameError: neither a preset nor a file.
        FormatError: the file is not TOML, or its keys are not a gripper's.
    """
    path = Path(name_or_path)
    if not path.suffix:
        path = GRIPPERS / f"{name_or_path}.toml"
    if not path.is_file():
        raise UnknownNameError("gripper", name_or_path, [*preset_names(), "a TOML file"])
    content = read_toml(path, "see pipelines/grippers")
    names = {field.name for field in fields(Gripper)}
    if set(content) != names:
        wrong = sorted(set(content) ^ names)
        found = f"{', '.join(wrong)[:LONGEST_REASON]} are missing or unknown"
        raise FormatError(path, found, f"the keys are {', '.join(sorted(names))}")
    with reading(path, "a measure", "metres, as in pipelines/grippers"):
        return Gripper(**content)
