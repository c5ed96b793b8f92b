"""Digests of the ground truth of a report's frames: labels, poses, meshes."""

from collections.abc import Iterable

from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_layout import SceneFiles
from pipelines.dataset.scene_digests import CAMERA_FILES, POSES, digest_of_files
from pipelines.frames.graspnet_scene import annotated_ids
from pipelines.inference import models
from pipelines.storage.files import existing
from pipelines.storage.provenance import digest, digest_folder, digest_text

LABELS = {"symmetry": "*.json", "regions": "*.json"}
# Without colour and depth images: these are gigabytes, input of `infer` and no ground truth.
SCENE_FOLDERS = {**POSES, "label": "*.png"}


def truth_digests(
    root: GraspNetRoot, scenes: Iterable[SceneFiles], *, baselines: bool
) -> dict[str, str]:
    """Return digests by kind.

    With `baselines` also of `affordance/` and of the grasp critic's weights: the oracle uses both.
    """
    scenes = list(scenes)
    labels = LABELS | ({"affordance": "*.h5"} if baselines else {})
    found = {
        name: digest_folder(root.root / name, pattern)
        for name, pattern in labels.items()
        if (root.root / name).is_dir()
    }
    ids = {i for scene in scenes for i in annotated_ids(scene.camera_folder / "annotations")}
    if baselines:
        found["grasp_critic"] = digest(
            existing(models.GRASP_CRITIC_WEIGHTS, models.GRASP_CRITIC_BY)
        )
    return found | {
        "meshes": digest_of_files(root.model_path(object_id) for object_id in sorted(ids)),
        "scenes": digest_text("".join(_digest_of_scene(scene) for scene in scenes)),
    }


def _digest_of_scene(scene: SceneFiles) -> str:
    folder = scene.camera_folder
    kinds = [digest_folder(folder / kind, pattern) for kind, pattern in SCENE_FOLDERS.items()]
    around = scene.surroundings_path
    kinds += [digest(around)] if around.is_file() else []
    return "".join([*kinds, digest_of_files(folder / name for name in CAMERA_FILES)])
