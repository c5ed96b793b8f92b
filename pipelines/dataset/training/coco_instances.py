"""Regions of frames as a COCO instance dataset, with depth and cameras next to the images.

    DIR/annotations/instances_{train,val}.json   COCO's; masks are compressed run lengths
    DIR/images/scene_NNNN/CAMERA/rgb/NNNN.png    `file_name` is relative to DIR/images
    DIR/images/scene_NNNN/CAMERA/depth/NNNN.png  as in the dataset, with camK.npy
    DIR/scenes/scene_NNNN_CAMERA.json            images and annotations of one scene

`pycocotools.coco.COCO` and torchvision's `CocoDetection` read the files. Additional fields are
`object_id`, `region`, `visible` and `symmetries` (camera frame, metres).
"""

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from pycocotools import mask as coco_mask

from pipelines.array_types import Mask
from pipelines.contents import reading
from pipelines.dataset.graspnet.graspnet_layout import FrameFiles, scene_name
from pipelines.dataset.symmetry.symmetry_labels import symmetry_to_json
from pipelines.errors import FormatError
from pipelines.frames.graspnet_scene import CAMERAS
from pipelines.geometry.region_masks import RegionInstance
from pipelines.geometry.symmetry import SYMMETRY_KINDS, RotationSymmetry, Symmetry
from pipelines.storage.files import read_json, write_json
from pipelines.storage.provenance import Stamp, version

Entry = dict[str, Any]

COCO_SPLITS = ("train", "val")
REGION_KINDS = (*SYMMETRY_KINDS, "none")  # categories 1 to 4
FRAMES_A_CAMERA, REGIONS_A_FRAME = 10_000, 256


@dataclass(frozen=True)
class CocoFrame:
    """One image of the dataset: its files, and its masks in order of annotation."""

    files: FrameFiles
    annotations: tuple[Entry, ...]

    @property
    def scene(self) -> str:
        """Name of scene and camera."""
        return scene_name(self.files.scene_id, self.files.camera)

    def masks(self) -> list[Mask]:
        """Return the masks (H, W) of the annotations."""
        return [annotation_mask(annotation) for annotation in self.annotations]


def annotations_path(folder: Path, split: str) -> Path:
    """Return the path of the annotations of `split`, train or val."""
    return folder / "annotations" / f"instances_{split}.json"


def is_coco(folder: Path) -> bool:
    """Return whether `folder` is a dataset of `export-coco`."""
    return annotations_path(folder, "train").is_file()


def image_entry(files: FrameFiles, width: int, height: int) -> Entry:
    """Return COCO's entry of an image; its id encodes scene, camera and frame."""
    place = 2 * files.scene_id + CAMERAS.index(files.camera)
    return {
        "id": place * FRAMES_A_CAMERA + files.frame_id + 1,
        "file_name": str(files.path("rgb").relative_to(files.camera_folder.parents[1])),
        "width": width,
        "height": height,
        "scene_id": files.scene_id,
        "camera": files.camera,
        "frame_id": files.frame_id,
    }


def annotation_entry(image: Entry, number: int, region: RegionInstance, category: int) -> Entry:
    """Return COCO's entry of the `number`-th region of `image`, from 1."""
    runs = coco_mask.encode(np.asfortranarray(region.mask.astype(np.uint8)))
    counts = cast(bytes, runs["counts"]).decode("ascii")
    return {
        "id": image["id"] * REGIONS_A_FRAME + number,
        "image_id": image["id"],
        "category_id": category,
        "segmentation": {"size": list(region.mask.shape), "counts": counts},
        "area": int(coco_mask.area(runs)),
        "bbox": [float(x) for x in coco_mask.toBbox(runs)],
        "iscrowd": 0,
        "object_id": region.object_id,
        "region": region.name,
        "visible": round(region.visible, 4),
        "symmetries": [symmetry_to_json(symmetry) for symmetry in region.symmetries],
    }


def annotation_mask(annotation: Mapping[str, Any]) -> Mask:
    """Return the mask (H, W) of an annotation."""
    runs = annotation["segmentation"]
    with warnings.catch_warnings():  # pycocotools' array class does not know NumPy 2's keywords
        warnings.simplefilter("ignore", DeprecationWarning)
        mask = coco_mask.decode({"size": runs["size"], "counts": runs["counts"]})
    return np.asarray(mask, np.bool_)


def kind_of(symmetries: Iterable[Symmetry]) -> str:
    """Return the kind of a region by precedence: sphere, continuous rotation, reflection, none."""
    kinds = {
        symmetry.kind
        for symmetry in symmetries
        if not (isinstance(symmetry, RotationSymmetry) and symmetry.order is not None)
    }
    return next((kind for kind in ("sphere", "rotation", "reflection") if kind in kinds), "none")


def category_of(region: RegionInstance, by: str) -> int:
    """Return the category of a region by kind, object or region."""
    if by == "kind":
        return REGION_KINDS.index(kind_of(region.symmetries)) + 1
    return region.object_id + 1 if by == "object" else 1


def category_entries(by: str, object_ids: Iterable[int]) -> list[Entry]:
    """Return COCO's entries of all categories."""
    if by == "kind":
        names = list(enumerate(REGION_KINDS, start=1))
    elif by == "object":
        names = [(object_id + 1, f"{object_id:03d}") for object_id in sorted(object_ids)]
    else:
        names = [(1, "region")]
    return [{"id": number, "name": name, "supercategory": by} for number, name in names]


def write(
    path: Path,
    images: Sequence[Entry],
    annotations: Sequence[Entry],
    categories: Sequence[Entry],
    stamp: Stamp,
) -> None:
    """Write one of COCO's annotation files."""
    content = {
        "info": {"description": "symmetric regions", "version": version()},
        "licenses": [],
        "images": list(images),
        "annotations": list(annotations),
        "categories": list(categories),
        "provenance": stamp.as_json(),
    }
    write_json(path, content)


def read_entries(path: Path) -> tuple[list[Entry], list[Entry]]:
    """Return the images and the annotations of one of COCO's files.

    Raises:
        FormatError: the file has no COCO instances.
    """
    content = read_json(path)
    if not isinstance(content, dict) or not {"images", "annotations"} <= set(content):
        raise FormatError(path, "lacks `images` or `annotations`", "COCO's instances are expected")
    return content["images"], content["annotations"]


def read_coco_frames(folder: Path, split: str) -> list[CocoFrame]:
    """Read the frames of `split`, with their annotations.

    Raises:
        FormatError: the folder is no COCO dataset, or lacks scenes, cameras and frames.
    """
    path = annotations_path(folder, split)
    images, annotations = read_entries(path)
    of_image: dict[int, list[Entry]] = {}
    with reading(path, "an image or annotation", "entries of `export-coco` are expected"):
        for annotation in annotations:
            of_image.setdefault(annotation["image_id"], []).append(annotation)
        return [
            CocoFrame(
                FrameFiles(
                    folder / "images" / f"scene_{image['scene_id']:04d}" / image["camera"],
                    image["scene_id"],
                    image["camera"],
                    image["frame_id"],
                ),
                tuple(sorted(of_image.get(image["id"], []), key=lambda each: int(each["id"]))),
            )
            for image in images
        ]
