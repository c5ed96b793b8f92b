"""Copy a dataset with the true depth of its objects: `python -m tools.true_depth ROOT OUT`.

OUT is ROOT with the depth of the true meshes at each measured pixel of an object. Missing pixels
stay missing, and table and surroundings keep the sensor's depth. All other files are hard links,
so that OUT takes little space and must be on the same disk.
"""

import argparse
import os
import shutil
from functools import cache
from pathlib import Path

import numpy as np

from pipelines.array_types import Array
from pipelines.dataset.graspnet.graspnet import GraspNetRoot, write_depth
from pipelines.dataset.graspnet.graspnet_layout import FrameFiles
from pipelines.dataset.meshes import read_mesh
from pipelines.errors import SymgraspError, errors_as_sentences
from pipelines.geometry.rendering import Scene, cast_view
from pipelines.storage.files import atomic_folder
from pipelines.storage.provenance import make_stamp, write_sidecar

_read_once = cache(read_mesh)  # an object is in many frames


def true_depth(root: GraspNetRoot, frame: FrameFiles) -> Array:
    """Return the depth (H, W) of `frame`, metres, true on objects, 0 = missing."""
    measured, intrinsics = root.read_depth(frame)
    poses = root.read_annotation(frame)
    meshes = [_read_once(root.model_path(each.object_id)) for each in poses]
    hits = cast_view(Scene(meshes, [each.T_cam_obj for each in poses]), intrinsics, np.eye(4))
    numbers = np.array([each.object_id + 1 for each in poses])
    seen = np.where(hits.object_index >= 0, numbers[hits.object_index], 0)
    # At an edge the sensor may have measured the surface beside the labelled one.
    same = (measured > 0) & (seen > 0) & (seen == root.read_label(frame))
    return np.where(same, hits.depth, measured)


def copy_with_true_depth(source: Path, out: Path) -> int:
    """Write `out` as described above; return its number of frames.

    Raises:
        SymgraspError: `out` exists.
    """
    if out.exists():
        raise SymgraspError(f"{out} exists; name a new folder")
    root, count = GraspNetRoot.finished(source), 0
    ignored = shutil.ignore_patterns("depth")
    with atomic_folder(out) as folder:
        shutil.copytree(source, folder, copy_function=os.link, ignore=ignored, dirs_exist_ok=True)
        copied, stamp = GraspNetRoot(folder), make_stamp("true_depth", {"root": str(source)})
        for scene in root.scenes():
            write_sidecar(copied.scene_folder(scene.scene_id), stamp)
            for frame in scene.frames():
                write_depth(copied.frame(frame.name).path("depth"), true_depth(root, frame))
                count += 1
    return count


@errors_as_sentences()
def main() -> None:
    """Read the options and copy."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("root", type=Path, help="dataset in GraspNet-1Billion's layout")
    parser.add_argument("out", type=Path, help="new folder")
    options = parser.parse_args()
    copy_with_true_depth(options.root, options.out)


if __name__ == "__main__":
    main()
