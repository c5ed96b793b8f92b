"""What tells that a scene, its frames and objects, is another one than something was made of.

Pictures of a dataset are gigabytes, so of these names and sizes count: a PNG of another picture has
another size, and of all frames of a scene nearly certainly one has. Poses and cameras, which may
change within their digits, are read.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path

from pipelines.dataset.graspnet.graspnet import GraspNetRoot, SceneFiles
from pipelines.errors import SymgraspError
from pipelines.storage.provenance import digest_folder, digest_if_there, digest_text

PICTURES = ("rgb", "depth", "label")
POSES = {"annotations": "*.xml", "meta": "*.mat"}
CAMERA_FILES = ("camK.npy", "camera_poses.npy", "cam0_wrt_table.npy")


def inputs_of_scenes(
    root: GraspNetRoot, scenes: Sequence[SceneFiles], *, with_affordance: bool = False
) -> list[dict[str, str]]:
    """Return, of each scene, what the regions of its frames are made of: digests by name.

    These are its frames, and of each object the mesh and the regions cut from it, with
    `with_affordance` its affordance too.
    """
    objects = {
        object_id: _inputs_of_object(root, object_id, with_affordance=with_affordance)
        # Taken once, not once a scene: meshes may be large.
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
    # A file that is not there fails its scenes, when it is read.
    return {name: digest_if_there(path) for name, path in files.items()}


def _object_ids(scene: SceneFiles) -> list[int]:
    """Return the scene's objects; none if the list is at fault, which then fails the scene."""
    try:
        return scene.object_ids
    except SymgraspError:
        return []


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
    sizes = (f"{p.name} {p.stat().st_size if p.is_file() else 'missing'}\n" for p in paths)
    return digest_text("".join(sizes))


def digest_of_files(paths: Iterable[Path]) -> str:
    """Return one digest of files; one that is absent counts as absent."""
    each = (f"{path.name} {digest_if_there(path)}\n" for path in paths)
    return digest_text("".join(each))
