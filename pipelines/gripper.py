"""Stage `gripper`: a gripper from a URDF, or a check of a gripper, each with a picture.

Reads   a URDF of a parallel gripper, or a gripper's TOML file, or a preset's name
Writes  OUT.toml for a URDF; the gripper's picture, PNG
"""

import time
from dataclasses import fields
from pathlib import Path

from pipelines.configs import GripperConfig
from pipelines.errors import SymgraspError
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasp_files.gripper_urdf import read_urdf_gripper
from pipelines.grasping.gripper import Gripper
from pipelines.pictures.gripper_pictures import draw_gripper
from pipelines.pictures.palette import ColorImage
from pipelines.runtime.batch import StageReport
from pipelines.runtime.one_run import one_run_at_a_time
from pipelines.storage.files import write_text
from pipelines.storage.images import encode_image, write_image
from pipelines.storage.provenance import refuse_other_suffix

STAGE = "gripper"
# Metres; shorter fingers, narrower grippers and longer measures are more likely errors of a unit.
USUAL_FINGER, USUAL_WIDTH, USUAL_LENGTH = 0.01, 0.02, 0.4


@one_run_at_a_time(STAGE, "output", "picture")
def run(
    source: str,
    config: GripperConfig,
    *,
    output: Path | None = None,
    picture: Path | None = None,
    overwrite: bool = False,
) -> StageReport:
    """Read a gripper, report its oddities, and write the requested files.

    `source`: URDF (`.urdf`, `.xml`), TOML file or preset. `output`: TOML file. `picture`: PNG.

    Raises:
        SymgraspError: `source` is no gripper, or an output file exists.
        ValueRangeError: `output` is not named .toml.
    """
    started, report = time.monotonic(), StageReport(STAGE)
    if output is not None:
        refuse_other_suffix(output, ".toml")
    if not overwrite:
        _refuse_existing(picture if output is None else output)
    gripper, odd = gripper_of(source, config)
    if picture is not None:
        image = draw_gripper(gripper)
        if not overwrite and not _shows(picture, image):
            _refuse_existing(picture)
        write_image(picture, image)
    if output is not None:
        write_text(output, as_gripper_toml(gripper, Path(source).name))
        load_gripper(str(output))
    report.done.append(gripper.name)
    odd += oddities_of(gripper)
    report.notes[gripper.name] = "; ".join(odd) or (
        f"opens {1000 * gripper.max_opening:.1f} mm, contacts up to "
        f"{1000 * gripper.max_width:.1f} mm apart; nothing is odd"
    )
    report.seconds = time.monotonic() - started
    return report


def _refuse_existing(path: Path | None) -> None:
    if path is not None and path.exists():
        raise SymgraspError(f"{path} exists; give --overwrite, or another name")


def _shows(picture: Path, image: ColorImage) -> bool:
    """Return whether the file `picture` is `image`, as a killed run leaves it without a TOML."""
    try:
        return picture.read_bytes() == encode_image(image, picture.suffix)
    except (OSError, SymgraspError):
        return False


def gripper_of(source: str, config: GripperConfig) -> tuple[Gripper, list[str]]:
    """Return the gripper of a URDF, a TOML file, or a preset, and oddities of a URDF's frame."""
    if Path(source).suffix.lower() not in (".urdf", ".xml"):
        return load_gripper(source), []
    return read_urdf_gripper(
        Path(source),
        tip_reach=config.tip_reach,
        clearance=config.clearance,
        base_link=config.base_link,
    )


def as_gripper_toml(gripper: Gripper, source: str) -> str:
    """Return the TOML text of a gripper, metres."""
    # Line breaks and other control characters would end the comment or the text.
    name, source = ("".join(filter(str.isprintable, text)) for text in (gripper.name, source))
    name = name.replace("\\", "").replace('"', "")
    lines = [f"# From {source.encode('ascii', 'replace').decode()}; metres.", f'name = "{name}"']
    lines += [f"{each.name} = {getattr(gripper, each.name):.5f}" for each in fields(Gripper)[1:]]
    return "\n".join(lines) + "\n"


def oddities_of(gripper: Gripper) -> list[str]:
    """Return the measures of a valid gripper that are unusual, a phrase each."""
    odd = []
    if gripper.finger_length + gripper.palm_depth > gripper.flange_to_tip + 1e-6:
        odd.append("fingers and palm together are longer than flange_to_tip")
    if gripper.tip_reach >= gripper.finger_length:
        odd.append("tip_reach is longer than the fingers")
    if gripper.finger_length < USUAL_FINGER:
        odd.append("the fingers are shorter than 1 cm")
    if gripper.max_width < USUAL_WIDTH:
        odd.append(f"contacts are at most {1000 * gripper.max_width:.1f} mm apart")
    for name in (each.name for each in fields(Gripper)[1:]):
        length = getattr(gripper, name)
        if length > USUAL_LENGTH or (length == 0.0 and name not in ("tip_reach", "clearance")):
            odd.append(f"{name} is {1000 * length:g} mm")
    return odd
