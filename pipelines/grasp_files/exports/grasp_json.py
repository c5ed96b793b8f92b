"""All grasps as one self-contained JSON text: units, frames, gripper, settings and stamps."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pipelines.grasp_files.exports.grasp_exports import ExportHeader, FrameGrasps, rounded
from pipelines.storage.files import atomic_path

FORMAT_VERSION = 2
CONVENTIONS = {
    "units": "metres; the camera in pixels",
    "rotation": "columns approach, closing, approach x closing",
    "translation": "midpoint of the contacts",
    "width": "distance of the contacts",
    "opening": "distance of the open fingers: width and the gripper's clearance on each side",
    "rank_score": "0 to 1, higher is better; it orders the grasps of a frame, rank_in_frame 0 "
    "first; is_best marks the best grasp of a region; worth_trying is false for low scores",
}


def write(path: Path, frames: Iterable[FrameGrasps], header: ExportHeader) -> None:
    """Write `frames`, one in memory at a time, one grasp per line."""
    head = {
        "format": "symgrasp-grasps",
        "format_version": FORMAT_VERSION,
        "conventions": {
            "axes": header.frame.axes,
            "pose": f"{header.gripper.words}; the contacts lie base_to_contacts before it along z",
            **CONVENTIONS,
        },
        "gripper": header.gripper.facts(),
        "infer": header.infer,
        "provenance": header.stamp,
    }
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8") as stream:
        stream.write(_text(head, indent=1).removesuffix("\n}") + ',\n "frames": [')
        separator = "\n"
        for frame in frames:
            stream.write(separator + frame_text(frame))
            separator = ",\n"
        stream.write("\n ]\n}\n")


def frame_text(frame: FrameGrasps, name: str | None = None) -> str:
    """Return a frame as JSON, one grasp per line; `name` replaces the frame's name, if given."""
    result, camera = frame.result, frame.result.intrinsics
    names = ("fx", "fy", "cx", "cy", "width", "height")
    facts = {
        "name": result.name if name is None else name,
        "status": result.status,
        "message": result.message,
        "camera": None if camera is None else {name: getattr(camera, name) for name in names},
        "left_out": frame.left_out.tolist(),
        "below_min_score": frame.low.tolist(),
    }
    lines = ",\n".join(f"   {_text(each)}" for each in _grasps(frame))
    grasps = f"[\n{lines}\n  ]" if lines else "[]"
    return f'  {_text(facts).removesuffix("}")}, "grasps": {grasps}}}'


def _grasps(frame: FrameGrasps) -> list[dict[str, Any]]:
    table = frame.result.grasps
    columns = {
        "rank_in_frame": table.rank_in_frame.tolist(),
        "grasp": frame.rows.tolist(),
        "region": table.region.tolist(),
        "instance": frame.instances.tolist(),
        "is_best": table.is_best.tolist(),
        "rank_score": rounded(table.rank_score),
        "worth_trying": table.worth_trying.tolist(),
        "affordance": rounded(table.affordance),
        "source": [str(source) for source in table.source],
        "symmetry": frame.symmetries,
        "contacts": rounded(frame.grasps.contacts),
        "rotation": rounded(frame.grasps.rotation),
        "translation": rounded(frame.grasps.translation),
        "width": rounded(frame.grasps.width),
        "opening": rounded(frame.opening),
        "pose": rounded(frame.poses),
    }
    rows = zip(*columns.values(), strict=True)
    return [dict(zip(columns, row, strict=True)) for row in rows]


def _text(content: object, indent: int | None = None) -> str:
    return json.dumps(content, indent=indent, allow_nan=False, ensure_ascii=False)
