"""Training frames of a detector in one small file for a GPU host.

`python -m tools.gpu_training.small_frames OUT.npz NAME.frames/ROOT [...]` writes it from the
folders that `symgrasp finetune-detector` prepares. Depth is stored in steps of half a millimetre,
colour as JPEG.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.contents import reason
from pipelines.dataset.training import detector_frames
from pipelines.dataset.training.detector_frames import DetectorFrame
from pipelines.errors import FormatError, ValueRangeError, counted, errors_as_sentences
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.pointcloud import Plane
from pipelines.storage.array_files import DAMAGED, write_npz
from pipelines.storage.files import existing
from pipelines.tabletop.depth_channels import SmallFrame

WRITTEN_BY = "python -m tools.gpu_training.small_frames"
DEPTH_STEP = 0.0005  # metres
JPEG_QUALITY = 85
IMAGES = ("color", "depth", "regions")


def write(path: Path, folders: Sequence[Path], stride: int = 1) -> int:
    """Write every `stride`-th frame of the files in `folders`; return their number.

    Raises:
        ValueRangeError: there is no frame.
    """
    rows: dict[str, list[Any]] = {name: [] for name in (*IMAGES, "plane", "lens")}
    for file in sorted(each for folder in folders for each in folder.glob("*.h5")):
        for row in range(0, detector_frames.count_frames(file), stride):
            view = detector_frames.read(file, row)
            steps = np.round(view.frame.depth / DEPTH_STEP).astype(np.uint16)
            jpeg = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
            rows["color"].append(_encoded(".jpg", view.frame.color[..., ::-1], jpeg))
            rows["depth"].append(_encoded(".png", steps, [cv2.IMWRITE_PNG_COMPRESSION, 9]))
            rows["regions"].append(_encoded(".png", view.regions, []))
            rows["plane"].append([*view.plane.normal, view.plane.offset])
            camera = view.frame.intrinsics
            rows["lens"].append([camera.fx, camera.fy, camera.cx, camera.cy])
    if not rows["plane"]:
        where = f"number of frames in {', '.join(map(str, folders))}"
        raise ValueRangeError(where, 0, "at least 1; give NAME.frames/ROOT")
    arrays = {name: np.array(rows[name]) for name in ("plane", "lens")}
    for name in IMAGES:
        arrays[name] = np.concatenate(rows[name])
        arrays[f"{name}_ends"] = np.cumsum([len(each) for each in rows[name]])
    write_npz(path, compress=False, **arrays)
    return len(arrays["plane"])


def _encoded(kind: str, image: NDArray[Any], options: list[int]) -> NDArray[np.uint8]:
    return np.asarray(cv2.imencode(kind, image, options)[1], np.uint8).ravel()


def count_small_frames(path: Path) -> int:
    """Return the number of frames in a file of `write`.

    Raises:
        MissingInputError: there is no such file.
        FormatError: the file is damaged, or holds something else.
    """
    try:
        with np.load(existing(path, WRITTEN_BY), allow_pickle=False) as file:
            return len(file["plane"])
    except DAMAGED as error:
        found = f"holds no frames of a detector ({reason(error)})"
        raise FormatError(path, found, f"a file of `{WRITTEN_BY}` is expected") from error


class SmallFrames:
    """The frames of a file of `write`."""

    def __init__(self, path: Path) -> None:
        with np.load(path, allow_pickle=False) as file:
            self._arrays = {name: file[name] for name in file.files}

    def __len__(self) -> int:
        return len(self._arrays["plane"])

    def __getitem__(self, number: int) -> DetectorFrame:
        color = self._image("color", number, cv2.IMREAD_COLOR)[..., ::-1]
        depth = self._image("depth", number, cv2.IMREAD_UNCHANGED).astype(np.float32)
        regions = self._image("regions", number, cv2.IMREAD_UNCHANGED)
        fx, fy, cx, cy = self._arrays["lens"][number].tolist()
        lens = Intrinsics(fx, fy, cx, cy, width=depth.shape[1], height=depth.shape[0])
        frame = SmallFrame(np.ascontiguousarray(color), depth * np.float32(DEPTH_STEP), lens)
        normal, offset = self._arrays["plane"][number, :3], float(self._arrays["plane"][number, 3])
        return DetectorFrame(frame, Plane(normal, offset), regions)

    def _image(self, name: str, number: int, kind: int) -> NDArray[Any]:
        ends = self._arrays[f"{name}_ends"]
        start = ends[number - 1] if number else 0
        return np.asarray(cv2.imdecode(self._arrays[name][start : ends[number]], kind))


@errors_as_sentences()
def main() -> None:
    """Read the options and write the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--stride", type=int, default=1, help="take every n-th frame")
    options = parser.parse_args()
    count = write(options.out, options.folders, options.stride)
    sys.stdout.write(f"{counted(count, 'frame')}\n")


if __name__ == "__main__":
    main()
