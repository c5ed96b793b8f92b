"""Speeds of making data: labels of an object, symmetries of a mesh, frames packed per second."""

import tempfile
from pathlib import Path

import numpy as np

from benchmarks.timing import Measurement, seconds_of
from pipelines import annotate_symmetry, pack, refine_grasps, synthesize
from pipelines.configs import (
    AnnotateSymmetryConfig,
    LabelConfig,
    PackConfig,
    RefineGraspsConfig,
    SynthesizeConfig,
)
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_label_stream import grasp_label_pieces
from pipelines.dataset.graspnet.graspnet_labels import LABEL_GRID
from pipelines.dataset.meshes import read_mesh
from pipelines.dataset.training.packed_regions import PackedReader
from pipelines.runtime.batch import BatchOptions
from pipelines.synthesis.labels.grasp_sampling import sample_grasp_label

QUIET = BatchOptions(progress=False)
NUM_OBJECTS, VIEWS_A_SCENE = 6, 2
NUM_PIECE_POINTS, NUM_READS = 32, 2000
LABELS = LabelConfig()
LABEL_NOTE = f"{LABELS.num_points} points, {LABELS.num_views} views"
SIZE_NOTE = "49.8 million per object of GraspNet-1Billion"
SMALL = SynthesizeConfig(
    splits=("train",),
    scenes_per_split=1,
    views=VIEWS_A_SCENE,
    objects_per_pool=NUM_OBJECTS,
    min_objects=NUM_OBJECTS,
    max_objects=NUM_OBJECTS,
    labels=LabelConfig(num_points=16),
)
SCENE_NOTE = f"{NUM_OBJECTS} objects, {VIEWS_A_SCENE} views, {SMALL.width} x {SMALL.height}"
FRAME_NOTE = f"{SMALL.width} x {SMALL.height}, {NUM_OBJECTS} objects, one process"


def measure() -> list[Measurement]:
    """Return the speeds of the dataset stages on a dataset of one small scene."""
    with tempfile.TemporaryDirectory() as folder:
        root = GraspNetRoot(Path(folder) / "root")
        made = synthesize.run(root.root, SMALL, QUIET)
        annotated = annotate_symmetry.run(root.root, None, AnnotateSymmetryConfig(), options=QUIET)
        refined = refine_grasps.run(root.root, RefineGraspsConfig(), options=QUIET)
        return [
            Measurement("synthesize a small scene", made.seconds, "s", SCENE_NOTE),
            Measurement("labels of an object", _label_seconds(root), "s", LABEL_NOTE),
            Measurement("annotate-symmetry, a mesh", annotated.seconds / len(annotated.done), "s"),
            Measurement("refine-grasps, an object", refined.seconds / len(refined.done), "s"),
            Measurement("refine-grasps, a label", _candidates(root), "candidates/s", SIZE_NOTE),
            Measurement("pack", 1.0 / _pack_seconds(root), "frames/s", FRAME_NOTE),
            _packed_reads(root, Path(folder) / "packed"),
        ]


def _label_seconds(root: GraspNetRoot) -> float:
    mesh = read_mesh(root.model_path(0))
    return seconds_of(lambda: sample_grasp_label(mesh, LABELS, np.random.default_rng(0)), 1)


def _pack_seconds(root: GraspNetRoot) -> float:
    frame = root.scenes()[0].frames()[0]
    rng = np.random.default_rng(0)
    return seconds_of(lambda: pack.pack_frame(root, frame, PackConfig(), rng))


def _candidates(root: GraspNetRoot) -> float:
    mesh, path, config = (
        read_mesh(root.model_path(0)),
        root.grasp_label_path(0),
        RefineGraspsConfig(),
    )

    def stream() -> None:
        refine_grasps.exact_grasps(mesh, grasp_label_pieces(path, NUM_PIECE_POINTS), config)

    return SMALL.labels.num_points * float(np.prod(LABEL_GRID)) / seconds_of(stream)


def _packed_reads(root: GraspNetRoot, folder: Path) -> Measurement:
    pack.run(root.root, folder, PackConfig(), options=QUIET)
    reader, size = PackedReader(folder), sum(path.stat().st_size for path in folder.iterdir())
    order = np.random.default_rng(0).integers(len(reader), size=NUM_READS).tolist()
    seconds = seconds_of(lambda: [reader[index] for index in order])
    note = f"random order, one process, {size / len(reader):,.0f} bytes per region"
    return Measurement("packed regions read", NUM_READS / seconds, "1/s", note)
