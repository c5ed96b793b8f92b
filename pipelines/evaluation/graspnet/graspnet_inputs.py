"""Digests of everything that decides the verdicts on a dumped scene: grasps, poses, meshes."""

import functools

from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_layout import SceneFiles
from pipelines.evaluation.graspnet.graspnet_truth import object_files
from pipelines.frames.graspnet_scene import annotated_ids
from pipelines.grasp_files.exports.graspnet_dump import DumpedScene
from pipelines.storage.provenance import digest_folder, digest_if_there, digest_text


class InputDigests:
    """Digests by scene; each mesh is read once, however many scenes it stands in."""

    def __init__(self, root: GraspNetRoot, *, exact: bool) -> None:
        self._root, self._exact = root, exact
        self._digest = functools.cache(digest_if_there)

    def of(self, dumped: DumpedScene) -> dict[str, str]:
        """Return digests of a scene's dump, poses and meshes; what is absent counts as absent."""
        folder = self._root.scene_folder(dumped.scene_id)
        files = SceneFiles(folder, dumped.scene_id, dumped.camera)
        return {
            "dump": digest_folder(dumped.folder, "*.npy"),
            "poses": self._poses(files),
            "meshes": self._meshes(files),
        }

    def _poses(self, files: SceneFiles) -> str:
        kinds = {"annotations": "*.xml"} | ({"meta": "*.mat"} if self._exact else {})
        parts = [digest_folder(files.camera_folder / kind, glob) for kind, glob in kinds.items()]
        cameras = ("camera_poses.npy", "cam0_wrt_table.npy")
        parts += [self._digest(files.camera_folder / name) for name in cameras]
        around = files.surroundings_path
        parts += [self._digest(around)] if around.is_file() else []
        return digest_text("".join(parts))

    def _meshes(self, files: SceneFiles) -> str:
        paths = [
            path
            for object_id in annotated_ids(files.camera_folder / "annotations")
            for path in object_files(self._root, object_id, exact=self._exact)
        ]
        return digest_text("".join(f"{path.name} {self._digest(path)}\n" for path in paths))
