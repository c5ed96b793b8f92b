"""Digests of a scene's inputs (frames, poses, objects), to detect stale outputs.

The images of a dataset are gigabytes, so only their names and sizes enter the digest: when images
change, the size of at least one PNG of a scene almost certainly changes. Poses and cameras, which
may change at equal size, are read.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path

from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_layout import IMAGE_KINDS, SceneFiles
from pipelines.errors import SymgraspError
from pipelines.storage.provenance import digest_folder, digest_if_there, digest_text

POSES = {"annotations": "*.xml", "meta": "*.mat"}
CAMERA_FILES = ("camK.npy", "camera_poses.npy", "cam0_wrt_table.npy")


def inputs_of_scenes(
    root: GraspNetRoot, scenes: Sequence[SceneFiles], *, with_affordance: bool = False
) -> list[dict[str, str]]:
    """Return the digests of the inputs of each scene's regions, by name.

    The inputs are its frames, and the mesh, the symmetries and, `with_affordance`, the affordance
    of each object.
    """
    objects = {
        object_id: _inputs_of_object(root, object_id, with_affordance=with_affordance)
        # Computed once per object, since meshes may be large.
        for object_id in sorted({i for scene in scenes for i in _object_ids(scene)})
    }
    found = []
    for scene in scenes:
        inputs = {"frames": digest_of_frames(scene)}
        for object_id in _object_ids(scene):
            inputs |= objects[object_id]
        found.append(inputs)
    return found


def _inputs_of_object(
    root: GraspNetRoot, object_id: int, *, with_affordance: bool
) -> dict[str, str]:
    files = {
        f"{object_id:03d}/{root.model_path(object_id).name}": root.model_path(object_id),
        root.symmetry_path(object_id).name: root.symmetry_path(object_id),
    }
    if with_affordance:
        files[root.affordance_path(object_id).name] = root.affordance_path(object_id)
    # A missing file fails its scenes later, when it is read.
    return {name: digest_if_there(path) for name, path in files.items()}


def _object_ids(scene: SceneFiles) -> list[int]:
    """Return the scene's objects; none if the list is broken, which fails the scene later."""
    try:
        return scene.object_ids
    except SymgraspError:
        return []


def digest_of_frames(scene: SceneFiles) -> str:
    """Return a digest of all frames of `scene`."""
    folder = scene.camera_folder
    images = (
        path
        for kind in IMAGE_KINDS
        for path in sorted((folder / kind).glob("*.png"))
        if not path.name.startswith(".")
    )
    poses = [digest_folder(folder / kind, pattern) for kind, pattern in POSES.items()]
    cameras = digest_of_files(folder / name for name in CAMERA_FILES)
    return digest_text("".join([digest_of_images(images), *poses, cameras]))


def digest_of_images(paths: Iterable[Path]) -> str:
    """Return a digest of the names and sizes of image files, some of which may be missing."""
    sizes = (f"{p.name} {p.stat().st_size if p.is_file() else 'missing'}\n" for p in paths)
    return digest_text("".join(sizes))


def digest_of_files(paths: Iterable[Path]) -> str:
    """Return a digest of the contents of files, some of which may be missing."""
    each = (f"{path.name} {digest_if_there(path)}\n" for path in paths)
    return digest_text("".join(each))
