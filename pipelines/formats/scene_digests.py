"""What tells that the frames of a scene are other ones than those something was made of.

Pictures of a dataset are gigabytes, so of these names and sizes count: a PNG of another picture has
another size, and of all frames of a scene nearly certainly one has. Poses and cameras, which may
change within their digits, are read.
"""

from collections.abc import Iterable
from pathlib import Path

from pipelines.formats.graspnet_layout import SceneFiles
from pipelines.formats.provenance import digest, digest_folder, digest_text

PICTURES = ("rgb", "depth", "label")
POSES = {"annotations": "*.xml", "meta": "*.mat"}
CAMERA_FILES = ("camK.npy", "camera_poses.npy", "cam0_wrt_table.npy")


def digest_of_frames(scene: SceneFiles) -> str:
    """Return a digest of all frames of `scene`."""
    folder = scene.camera_folder
    pictures = (
        path
        for kind in PICTURES
        for path in sorted((folder / kind).glob("*.png"))
        if not path.name.startswith(".")
    )
    poses = [digest_folder(folder / kind, pattern) for kind, pattern in POSES.items()]
    cameras = digest_of_files(folder / name for name in CAMERA_FILES)
    return digest_text("".join([digest_of_pictures(pictures), *poses, cameras]))


def digest_of_pictures(paths: Iterable[Path]) -> str:
    """Return a digest of the names and sizes of pictures; of one that is absent says so."""
    sizes = (f"{p.name} {p.stat().st_size if p.is_file() else 'absent'}\n" for p in paths)
    return digest_text("".join(sizes))


def digest_of_files(paths: Iterable[Path]) -> str:
    """Return one digest of files; one that is absent counts as absent."""
    each = (f"{path.name} {digest(path) if path.is_file() else 'absent'}\n" for path in paths)
    return digest_text("".join(each))
