"""Gripper presets and users' grippers, as TOML."""

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from pipelines.configs.toml_files import read_toml
from pipelines.contents import LONGEST_REASON, mapping_in, reading
from pipelines.errors import FormatError, SymgraspError, UnknownNameError
from pipelines.grasping.gripper import Gripper
from pipelines.storage.files import existing
from pipelines.storage.provenance import digest_text

GRIPPERS = Path(__file__).parent.parent / "grippers"


def preset_names() -> list[str]:
    """Return the names of the grippers that come with the toolkit."""
    return sorted(path.stem for path in GRIPPERS.glob("*.toml"))


def gripper_digest(name_or_path: str) -> str:
    """Return a digest of a gripper's measures, not of its name; errors as in `load_gripper`."""
    return digest_text(repr(replace(load_gripper(name_or_path), name="")))


def gripper_to_use(wanted: str, used: str, stamp: Mapping[str, Any]) -> str:
    """Return the gripper to evaluate grasps with: `wanted`, else the gripper of the grasps.

    Args:
        wanted: preset or TOML file; empty if none was named.
        used: gripper that the grasps were found for.
        stamp: of the run that found the grasps, as JSON.

    Raises:
        SymgraspError: `wanted` is unknown; or it is empty and `used` is missing or has changed.
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
        why = "no longer exists or is not below this folder"
    raise SymgraspError(f"gripper {used}, which the grasps were found for, {why}; name a --gripper")


def is_found_for(gripper: str, used: str, stamp: Mapping[str, Any]) -> bool:
    """Return whether grasps were found for the measures of `gripper`.

    `used`: gripper that they were found for. `stamp`: of the run that found them; an old one has no
    measures, and the names count.
    """
    found = mapping_in(stamp, "inputs").get("gripper")
    return gripper == used if found is None else bool(found == gripper_digest(gripper))


def load_gripper(name_or_path: str) -> Gripper:
    """Return the gripper of a preset's name or of a TOML file.

    Raises:
        UnknownNameError: there is no preset of this name.
        SymgraspError: there is no file of this name.
        FormatError: the file is not TOML, or its keys are not the keys of a gripper.
    """
    path = Path(name_or_path)
    if path.suffix:
        existing(path)
    elif not (path := GRIPPERS / f"{name_or_path}.toml").is_file():
        raise UnknownNameError("gripper", name_or_path, [*preset_names(), "a TOML file"])
    content = read_toml(path, "see pipelines/grippers")
    names = {field.name for field in fields(Gripper)}
    faults = [
        f"{fault} {', '.join(sorted(wrong))[:LONGEST_REASON]}"
        for fault, wrong in (
            ("lacks", names - set(content)),
            ("has the unknown", set(content) - names),
        )
        if wrong
    ]
    if faults:
        raise FormatError(path, " and ".join(faults), f"the keys are {', '.join(sorted(names))}")
    with reading(path, "a measure", "metres, as in pipelines/grippers"):
        return Gripper(**content)
