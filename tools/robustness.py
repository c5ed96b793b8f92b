"""Curves of grasp quality over camera and images: `python -m tools.robustness ROOT OUT`.

ROOT is an output of `synthesize` and `annotate-symmetry`. Each point of `robustness_points` sees
every scene of ROOT once: OUT/POINT holds its images, grasps.h5 and report.json. The table compares
each point with the usual camera, on the objects that both see. Finished points are kept;
`--points NAME ...` makes some, and `--infer OPTION ...` passes options on.
"""

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_layout import SceneFiles
from pipelines.dataset.meshes import read_mesh
from pipelines.errors import errors_as_sentences
from pipelines.evaluation.rows import OURS
from pipelines.evaluation.runs.records import read_frame_records, records_folder
from pipelines.evaluation.runs.tallies import WITHOUT_GRASP
from pipelines.metrics.grasp_verdicts import Verdict
from pipelines.metrics.paired_bootstrap import FrameMeans, differences
from pipelines.storage.files import atomic_folder
from pipelines.synthesis.scenes.cameras import camera_folder
from pipelines.synthesis.scenes.scene_files import write_views
from pipelines.synthesis.scenes.surroundings import SceneSurroundings
from pipelines.synthesis.scenes.tables import SceneLayout, SceneObject, View, record
from tools.robustness_points import CURVE_POINTS, USUAL, Point

SEED, TAG_AZIMUTH, TAG_VIEW, TAG_EDIT = 7310, 0, 9, 10
OF_OBJECTS = ("models", "symmetry", "objects.json")
RESAMPLES, LEVEL = 2000, 0.95
FIGURES: dict[str, Callable[[Verdict], float]] = {
    "quality": lambda verdict: verdict.quality,
    "region": lambda verdict: verdict.reason != "no region",
    "grasp": lambda verdict: verdict.reason not in WITHOUT_GRASP,
    "antipodal": lambda verdict: verdict.antipodal,
}

Verdicts = dict[str, dict[int, Verdict]]  # by frame and object


def layout_of(root: GraspNetRoot, scene: SceneFiles) -> SceneLayout:
    """Return the objects of a scene at rest, and the solids around them."""
    frame = next(iter(scene.frames()))
    objects, poses = [], []
    for each in root.read_annotation(frame):
        mesh = read_mesh(root.model_path(each.object_id))
        objects.append(SceneObject(each.object_id, f"{each.object_id:03d}", mesh, pieces=()))
        poses.append(scene.table_from_camera(frame.frame_id) @ each.T_cam_obj)
    around = SceneSurroundings(solids=tuple(scene.surroundings))
    return SceneLayout(tuple(objects), np.stack(poses), around)


def edited(views: Iterable[View], point: Point, rng: np.random.Generator) -> Iterable[View]:
    """Yield `views` with the edit of `point`, if it has one."""
    for view in views:
        if point.edit is None:
            yield view
        else:
            color, depth = point.edit(view, rng)
            yield replace(view, color=color, depth=depth)


def write_point(root: GraspNetRoot, point: Point, out: Path) -> None:
    """Write the views of `point` of all scenes of `root` as a root `out`."""
    camera = camera_folder(point.sensor)
    with atomic_folder(out) as folder:
        for name in OF_OBJECTS:
            if (shared := root.root / name).exists():
                (folder / name).symlink_to(shared.resolve())
        for scene in root.scenes():
            seeds = [SEED, scene.scene_id]
            layout = layout_of(root, scene)
            azimuth = np.random.default_rng(seeds).uniform(0.0, 2.0 * np.pi)
            pose = point.pose(layout.center, azimuth)[None]
            rng = np.random.default_rng([SEED, TAG_VIEW, scene.scene_id])
            views = record(layout, pose, point.intrinsics, point.sensor, rng)
            shown = edited(views, point, np.random.default_rng([SEED, TAG_EDIT, scene.scene_id]))
            into = folder / "scenes" / scene.folder.name
            write_views(into, camera, shown, layout, pose, point.intrinsics)


def run(*arguments: object) -> None:
    """Run a command of `symgrasp` in this process, so that weights are loaded once.

    Its report goes to stderr: stdout has the table of the points alone.

    Raises:
        SystemExit: the command failed, and has said why.
    """
    from symgrasp_cli.app import app  # noqa: PLC0415 - slow to load, and the table needs no command

    try:
        with redirect_stdout(sys.stderr):
            app([str(each) for each in arguments])
    except SystemExit as ended:
        if ended.code:
            raise


def make_point(root: GraspNetRoot, name: str, out: Path, options: Sequence[str]) -> None:
    """Write images, grasps and report of one point to the folder `out`; finished files are kept."""
    point, images = CURVE_POINTS[name], out / "root"
    grasps, report = out / "grasps.h5", out / "report.json"
    if not images.exists():
        write_point(root, point, images)
    run("infer", images, "--out", grasps, "--workers", 1, "--quiet", *options)
    least = ("--min-visible-pixels", point.min_visible_pixels)
    run("evaluate", grasps, "--dataset", images, "--out", report, "--workers", 1, "-q", *least)


def read_verdicts(report: Path) -> Verdicts:
    """Return the verdicts on our best grasps, by frame and object."""
    files = sorted(records_folder(report).glob("*.json"))
    records = [record for file in files for record in read_frame_records(file)]
    return {r.name: {v.object_id: v for v in r.rows[OURS].verdicts} for r in records}


def compared_cells(usual: Verdicts, other: Verdicts) -> list[str]:
    """Return the cells of a row: number of objects that both see, each figure, its difference."""
    frames = sorted(usual.keys() & other.keys())
    common = [sorted(usual[name].keys() & other[name].keys()) for name in frames]
    counts = np.array([len(ids) for ids in common], np.float64)
    cells = [f"{counts.sum():.0f}"]
    for figure in FIGURES.values():
        means = [
            FrameMeans(np.array(_sums(run, frames, common, figure)), counts)
            for run in (usual, other)
        ]
        group = np.arange(len(frames))
        values, (found,) = differences([*means], group, RESAMPLES, LEVEL, SEED)
        ends = f"{found.low:.3f} to {found.high:.3f}"
        cells.append(f"{values[1]:.3f} ({found.value:+.3f}, {ends})")
    return cells


def _sums(
    run: Verdicts,
    frames: Sequence[str],
    common: Sequence[Sequence[int]],
    figure: Callable[[Verdict], float],
) -> list[float]:
    pairs = zip(frames, common, strict=True)
    return [float(sum(figure(run[name][i]) for i in ids)) for name, ids in pairs]


@errors_as_sentences()
def main() -> None:
    """Make the points, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("root", type=lambda text: GraspNetRoot.finished(Path(text)))
    parser.add_argument("out", type=Path)
    parser.add_argument(
        "--points", nargs="+", choices=list(CURVE_POINTS), default=list(CURVE_POINTS)
    )
    parser.add_argument("--infer", nargs=argparse.REMAINDER, default=[])
    options = parser.parse_args()
    names = [USUAL, *(name for name in options.points if name != USUAL)]
    sys.stdout.write(f"| point | objects | {' | '.join(FIGURES)} |\n")
    usual: Verdicts = {}
    for name in names:
        out = options.out / name.replace(" ", "_").replace("%", "percent").replace("'", "")
        make_point(options.root, name, out, options.infer)
        found = read_verdicts(out / "report.json")
        usual = usual or found
        sys.stdout.write(f"| {name} | {' | '.join(compared_cells(usual, found))} |\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
