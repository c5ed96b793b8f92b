"""`evaluate` on 2,000 frames: frames per second, and peak memory.

A small scene is made, and links to its frames form eight scenes of 250 views: the amount of reading
and scoring is that of 2,000 different frames.
"""

import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.timing import Measurement
from pipelines import annotate_symmetry, synthesize
from pipelines.configs import (
    AnnotateSymmetryConfig,
    InferConfig,
    LabelConfig,
    SynthesizeConfig,
)
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_layout import SceneFiles
from pipelines.frames.graspnet_scene import write_pose_array
from pipelines.grasp_files import grasps_file
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.inference.frame_grasps import Planner
from pipelines.runtime.batch import BatchOptions
from pipelines.storage.provenance import make_stamp

QUIET = BatchOptions(progress=False)
NUM_SCENES, VIEWS_A_SCENE, NUM_DIFFERENT, NUM_OBJECTS = 8, 250, 5, 4
SMALL = SynthesizeConfig(
    splits=("seen",),
    scenes_per_split=1,
    views=NUM_DIFFERENT,
    objects_per_pool=NUM_OBJECTS,
    min_objects=NUM_OBJECTS,
    max_objects=NUM_OBJECTS,
    sensor="perfect",
    width=320,
    height=240,
    labels=LabelConfig(num_points=0),
)
KINDS = ("rgb", "depth", "label", "annotations", "meta")
CHILD = """
import sys, time
from pathlib import Path
from pipelines import evaluate
from pipelines.runtime.batch import BatchOptions
from pipelines.configs import EvaluateConfig

grasps, root, report = map(Path, sys.argv[1:])
started = time.process_time()
done = evaluate.run(grasps, root, report, EvaluateConfig(), BatchOptions(progress=False)).done
peak = next(line for line in Path("/proc/self/status").read_text().splitlines() if "VmHWM" in line)
print(len(done), time.process_time() - started, peak.split()[1])
"""


def measure() -> list[Measurement]:
    """Return speed and peak memory of one process; no values if the system does not report them."""
    frames = NUM_SCENES * VIEWS_A_SCENE
    note = (
        f"{frames:,} frames of {NUM_OBJECTS} objects, {SMALL.width} x {SMALL.height}, one process"
    )
    if not Path("/proc/self/status").is_file():
        return [Measurement("evaluate", None, "frames/CPU-s", note)]
    with tempfile.TemporaryDirectory() as folder:
        grasps, root = _many_frames(Path(folder))
        command = [sys.executable, "-c", CHILD, grasps, root, Path(folder) / "report.json"]
        text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        scenes, seconds, kilobytes = text.split()
    if int(scenes) != NUM_SCENES:
        raise RuntimeError(f"evaluate finished {scenes} of {NUM_SCENES} scenes")
    return [
        Measurement("evaluate", frames / float(seconds), "frames/CPU-s", note),
        Measurement("evaluate, peak memory", float(kilobytes) / 1024.0, "MB", note),
    ]


def _many_frames(folder: Path) -> tuple[Path, Path]:
    """Write a dataset and its grasps; return the file and the root."""
    root = GraspNetRoot(folder / "root")
    synthesize.run(root.root, SMALL, QUIET)
    annotate_symmetry.run(root.root, None, AnnotateSymmetryConfig(), options=QUIET)
    source = root.scenes("realsense")[0]
    config = InferConfig(regions="geometric", method="planar")
    planner, rng = Planner(config, load_gripper(config.gripper)), np.random.default_rng(0)
    found = [planner.plan(root.read_frame(frame), rng) for frame in source.frames()]
    names = []
    for number in range(1, NUM_SCENES + 1):
        copy = SceneFiles(root.scene_folder(source.scene_id + number), 0, source.camera)
        _link_scene(source, copy)
        scene = root.scene(source.scene_id + number, source.camera)
        names += [frame.name for frame in scene.frames()]
    results = [replace(found[i % NUM_DIFFERENT], name=name) for i, name in enumerate(names)]
    stamp = make_stamp("infer", {"gripper": config.gripper})
    grasps_file.write(folder / "grasps.h5", results, stamp)
    return folder / "grasps.h5", root.root


def _link_scene(source: SceneFiles, copy: SceneFiles) -> None:
    """Fill `copy` with `VIEWS_A_SCENE` views that are links to the views of `source` in turn."""
    for kind in KINDS:
        copy.frame(0).path(kind).parent.mkdir(parents=True)
        for view in range(VIEWS_A_SCENE):
            original = source.frame(view % NUM_DIFFERENT).path(kind)
            os.link(original, copy.frame(view).path(kind))
    for name in ("camK.npy", "cam0_wrt_table.npy"):
        os.link(source.camera_folder / name, copy.camera_folder / name)
    poses = source.camera_poses[np.arange(VIEWS_A_SCENE) % NUM_DIFFERENT]
    write_pose_array(copy.camera_folder / "camera_poses.npy", poses)
