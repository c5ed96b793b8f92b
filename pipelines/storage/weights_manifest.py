"""`manifest.json` next to the default weights: digests, and the grasps of a golden frame.

`python tools/golden_frame.py` writes it anew whenever weights, frames or `infer` itself change.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.array_types import Array
from pipelines.contents import reading
from pipelines.errors import FormatError
from pipelines.storage.files import read_json, write_json
from pipelines.storage.provenance import Stamp

MADE_BY = "python tools/golden_frame.py"


@dataclass(frozen=True)
class GoldenGrasps:
    """The best grasp of each region of the golden frame, camera frame."""

    rotation: Array  # (n, 3, 3) columns approach, closing, approach x closing
    translation: Array  # (n, 3) metres, midpoint of the contacts
    width: Array  # (n,) metres

    def __len__(self) -> int:
        return len(self.width)


@dataclass(frozen=True)
class Manifest:
    """Content of `manifest.json`: a digest of each file, and the grasps of `infer` in a frame."""

    files: Mapping[str, str]  # path relative to the manifest's folder, to its digest
    frame: str
    grasps: GoldenGrasps


def manifest_path(folder: Path) -> Path:
    """Return the path of the manifest of a folder of weights."""
    return folder / "manifest.json"


def write_manifest(path: Path, manifest: Manifest, stamp: Stamp) -> None:
    """Write `manifest`; the same manifest gives the same bytes."""
    grasps = manifest.grasps
    rows = [
        {
            "translation": np.round(grasps.translation[i], 6).tolist(),
            "rotation": np.round(grasps.rotation[i], 6).tolist(),
            "width": round(float(grasps.width[i]), 6),
        }
        for i in range(len(grasps))
    ]
    content = {"files": dict(manifest.files), "frame": manifest.frame, "grasps": rows}
    write_json(path, content | {"provenance": stamp.as_json()})


def read_manifest(path: Path) -> Manifest:
    """Read the manifest of a folder of weights.

    Raises:
        FormatError: no JSON, or not a manifest.
    """
    content: Any = read_json(path)
    with reading(path, "this manifest of weights", f"run {MADE_BY}"):
        rows = content["grasps"]
        grasps = GoldenGrasps(
            np.array([row["rotation"] for row in rows], np.float64).reshape(-1, 3, 3),
            np.array([row["translation"] for row in rows], np.float64).reshape(-1, 3),
            np.array([row["width"] for row in rows], np.float64).reshape(-1),
        )
        files = {str(name): str(digest) for name, digest in content["files"].items()}
        manifest = Manifest(files, str(content["frame"]), grasps)
    if not len(grasps) == len(grasps.rotation) == len(grasps.translation):
        raise FormatError(path, "its grasps are not whole", f"run {MADE_BY}")
    return manifest
