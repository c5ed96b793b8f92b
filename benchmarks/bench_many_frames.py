"""`infer` on 500 frames: seconds per frame, and peak memory of its processes.

Twenty frames of eight objects are made, and the folder has 25 links to each: the amount of reading,
planning and writing is that of 500 different frames. Real frames are measured too, if
`../shared/frames` exists.
"""

import contextlib
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil

from benchmarks.timing import Measurement
from pipelines import convert_frames, synthesize
from pipelines.configs import ConvertFramesConfig, LabelConfig, SynthesizeConfig
from pipelines.runtime.batch import BatchOptions

QUIET = BatchOptions(progress=False)
NUM_FRAMES, NUM_SCENES, VIEWS_A_SCENE, NUM_OBJECTS = 500, 5, 4, 8
TABLES = SynthesizeConfig(
    splits=("seen",),
    scenes_per_split=NUM_SCENES,
    views=VIEWS_A_SCENE,
    objects_per_pool=24,
    min_objects=NUM_OBJECTS,
    max_objects=NUM_OBJECTS,
    width=640,
    height=480,
    collision_labels=False,
    labels=LabelConfig(num_points=0),
)
REAL = Path(__file__).parents[2] / "shared" / "frames"
CHILD = """
import sys, time
from pathlib import Path
from pipelines import infer
from pipelines.runtime.batch import CHOSEN, BatchOptions
from pipelines.configs import InferConfig
from pipelines.grasp_files.grasps_stream import read_index

frames, out = map(Path, sys.argv[1:])
started = time.perf_counter()
options = BatchOptions(workers=CHOSEN, progress=False)
infer.run(infer.InferPaths(frames, out), InferConfig(), options)
print(len(read_index(out).names), time.perf_counter() - started)
"""
LOOK = 0.5  # seconds between two readings of the memory


def measure() -> list[Measurement]:
    """Return speed and peak memory; no values if the system does not report them."""
    note = f"of {NUM_OBJECTS} objects, 640 x 480, all cores, start included"
    if not Path("/proc/self/smaps_rollup").is_file():
        return [Measurement("infer", None, "s/frame", f"{NUM_FRAMES} frames {note}")]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        few = _flat_tables(folder)
        lines = [*_measured(few, folder, note), *_measured(_linked(few, folder), folder, note)]
        if REAL.is_dir():
            lines += _measured(_real(folder), folder, "real, of several cameras")
    return lines


def _measured(frames: Path, folder: Path, note: str) -> list[Measurement]:
    """Return seconds per frame and peak memory of `infer` on the folder `frames`."""
    out = folder / f"{len(list(folder.iterdir()))}.h5"
    command, peak = [sys.executable, "-c", CHILD, frames, out], 0.0
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        while process.poll() is None:
            peak = max(peak, _megabytes(process.pid))
            time.sleep(LOOK)
        text = process.communicate()[0]
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command[:2])
    count, seconds = text.split()
    label = f"{count} frames, {note}"
    return [
        Measurement("infer", float(seconds) / int(count), "s/frame", label),
        Measurement("infer, peak memory", peak, "MB", f"{label}, all processes"),
    ]


def _megabytes(pid: int) -> float:
    """Return the memory of a process and its children; shared memory counts once."""
    total = 0
    with contextlib.suppress(psutil.NoSuchProcess):  # the process has ended
        parent = psutil.Process(pid)
        for process in (parent, *parent.children(recursive=True)):
            with contextlib.suppress(psutil.NoSuchProcess, psutil.ZombieProcess):
                total += process.memory_full_info().pss
    return total / 2**20


def _flat_tables(folder: Path) -> Path:
    """Write frames of tables as flat pairs; return their folder."""
    synthesize.run(folder / "root", TABLES, QUIET)
    convert_frames.run(folder / "root", folder / "few", ConvertFramesConfig())
    return folder / "few"


def _real(folder: Path) -> Path:
    """Return a folder of links to the real frames, without their masks."""
    real = folder / "real"
    real.mkdir()
    for kind in ("camera.json", "color.png", "depth.png", "depth.npz"):
        for source in REAL.glob(f"*/*_{kind}"):
            (real / source.name).symlink_to(source)
    return real


def _linked(few: Path, folder: Path) -> Path:
    """Return a folder with `NUM_FRAMES` links to the frames of `few`."""
    many = folder / "many"
    many.mkdir()
    for number in range(NUM_FRAMES // (NUM_SCENES * VIEWS_A_SCENE)):
        for source in sorted(few.rglob("*_*.*")):
            scene = source.parent.parent.name
            os.link(source, many / f"{number:02d}_{scene}_{source.name}")
    return many
