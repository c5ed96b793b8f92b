"""Upper bound of a compared method: its labels through its post-processing.

`python -m tools.peer_oracle gg-cnn ROOT OUT.h5` writes the grasps of a method that predicts its
training labels exactly; `symgrasp evaluate OUT.h5 --dataset ROOT` scores them. ROOT has the labels
of `synthesize --collision-labels`. No training can exceed these grasps: grasps of planar methods
approach along the camera's axis and take the surface at their middle for the depth of the fingers.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from pipelines.array_types import Array
from pipelines.configs import InferConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_labels import read_rect
from pipelines.dataset.graspnet.graspnet_views import view_rotations
from pipelines.errors import errors_as_sentences
from pipelines.frames.rgbd import Frame
from pipelines.grasp_files import grasps_file
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.peers.cloud_box import boxed_points
from pipelines.grasping.peers.grasp_maps import MAP_SIDE, GraspMaps, scaled_rows
from pipelines.grasping.peers.oriented_boxes import (
    horizontal_boxes,
    orientation_classes,
    rows_of_boxes,
)
from pipelines.grasping.peers.rectangles import hold_at, on_their_object, rectangle_grasps
from pipelines.grasping.scene import SceneCloud
from pipelines.inference.frame_grasps import Planner
from pipelines.inference.peers.graspnet import best_hands, collision_free_grasps
from pipelines.learning.peers import ggcnn_training, multi_grasp_training
from pipelines.learning.peers.graspnet_clouds import labelled_scene
from pipelines.learning.peers.graspnet_labels import graspnet_frame_arrays
from pipelines.network.peers.graspnet import DEPTHS, GRASPNET_SIZES, NUM_TURNS, Operations
from pipelines.network.sampling import farthest_points
from pipelines.storage.provenance import make_stamp

Represented = Callable[[Array, tuple[int, int]], Array]


def as_maps(rows: Array, shape: tuple[int, int]) -> Array:
    """Return rectangles `rows` (n, 7) of an image (H, W) painted as GG-CNN's maps and read back."""
    scale = MAP_SIDE / min(shape)
    height, width = (round(side * scale) for side in shape)
    painted = GraspMaps.painted(scaled_rows(rows, scale), (height, width))
    return scaled_rows(painted.rectangles(), 1.0 / scale)


def as_boxes(rows: Array, shape: tuple[int, int]) -> Array:
    """Return rectangles `rows` (n, 7) as Multi-Grasp's boxes with classes, and back."""
    del shape  # boxes have no resolution
    return rows_of_boxes(horizontal_boxes(rows), orientation_classes(rows), rows[:, 5])


# Method -> its representation, and the largest friction coefficient of its training rectangles.
REPRESENTATIONS: dict[str, tuple[Represented, float]] = {
    "gg-cnn": (as_maps, ggcnn_training.LABEL_FRICTION),
    "multi-grasp": (as_boxes, multi_grasp_training.LABEL_FRICTION),
}


METHODS = (*REPRESENTATIONS, "graspnet")


@dataclass(frozen=True)
class RectangleLabels:
    """A `FrameMethod`: a planar method that knows the labels."""

    root: GraspNetRoot
    name: str
    gripper: Gripper

    def grasps(
        self, frame: Frame, scene: SceneCloud, rng: np.random.Generator
    ) -> tuple[GraspPoses, Array]:
        """Return the labelled grasps of a dataset frame after the method's post-processing."""
        del rng  # nothing is drawn
        represented, friction = REPRESENTATIONS[self.name]
        files = self.root.frame(frame.name)
        rows = read_rect(files.path("rect")).astype(np.float64)
        rows = rows[hold_at(rows, friction) & on_their_object(rows, self.root.read_label(files))]
        shape = scene.depth.shape[0], scene.depth.shape[1]
        rows = represented(rows, shape)
        grasps, index = rectangle_grasps(rows, scene.depth, scene.intrinsics, self.gripper)
        return grasps, rows[index, 5]


@dataclass(frozen=True)
class CellLabels:
    """A `FrameMethod`: GraspNet's baseline with the labels of its seeds as its predictions."""

    root: GraspNetRoot
    gripper: Gripper

    def grasps(
        self, frame: Frame, scene: SceneCloud, rng: np.random.Generator
    ) -> tuple[GraspPoses, Array]:
        """Return the labelled grasps of a dataset frame after the method's post-processing."""
        labels = graspnet_frame_arrays(self.root, self.root.frame(frame.name))
        if not len(labels["cell"]):
            return GraspPoses.empty(), np.zeros(0)
        sizes = GRASPNET_SIZES["light"]
        cloud = labelled_scene(labels, sizes.input, rng, 0.0)
        objects = cloud.points[cloud.on_object]
        seeds = objects[farthest_points(objects[None], min(sizes.points[1], len(objects)))[0]]
        nearest = torch.cdist(seeds, cloud.places).argmin(dim=1)
        view = cloud.value.amax(dim=2)[nearest].argmax(dim=1)
        value, width, tolerance = (
            each[nearest, view].view(1, -1, NUM_TURNS, DEPTHS).transpose(2, 3)
            for each in (cloud.value, cloud.width, cloud.tolerance)
        )
        # Turns about the approach axis are the same in the frame of every view.
        turns = np.swapaxes(view_rotations()[0, 0], 0, 1) @ view_rotations()[0]
        frames = cloud.turns[nearest, view].numpy()[:, None] @ turns
        predicted = Operations(value, value, width, tolerance)
        hands, score = best_hands(seeds.numpy(), frames, predicted)
        seen = scene.xyz[boxed_points(scene)]
        return collision_free_grasps(hands, score, seen, scene, self.gripper)


def write_oracle(name: str, root: GraspNetRoot, out: Path, scenes: int) -> int:
    """Write the grasps of the first `scenes` scenes; return the number of frames."""
    config, gripper = InferConfig(method=name, regions="geometric"), load_gripper("rg2")
    labels = (
        CellLabels(root, gripper) if name == "graspnet" else RectangleLabels(root, name, gripper)
    )
    planner = Planner(config, gripper, peer=labels.grasps)
    results = [
        planner.plan(root.read_frame(files), np.random.default_rng(0))
        for scene in root.scenes()[:scenes]
        for files in scene.frames()
    ]
    grasps_file.write(out, results, make_stamp("infer", config))
    return len(results)


@errors_as_sentences()
def main() -> None:
    """Read the options and write the grasps."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("method", choices=METHODS)
    parser.add_argument("root", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--scenes", type=int, default=1000)
    options = parser.parse_args()
    root = GraspNetRoot.finished(options.root)
    write_oracle(options.method, root, options.out, options.scenes)


if __name__ == "__main__":
    main()
