"""`infer` on 500 frames in one process: seconds a frame, and how much memory that takes.

Twenty frames of eight objects are made, and each stands in the folder 25 times as links: what is
read, found and written is as much as for so many different frames. The same of real frames, where
`../shared/frames` is there.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.timing import Measurement
from pipelines import convert_frames, synthesize
from pipelines.batch import BatchOptions
from pipelines.configs import ConvertFramesConfig, LabelConfig, SynthesizeConfig

QUIET = BatchOptions(progress=False)
NUM_FRAMES, NUM_SCENES, NUM_VIEWS, NUM_OBJECTS = 500, 5, 4, 8
TABLES = SynthesizeConfig(
    splits=("seen",),
    scenes_per_split=NUM_SCENES,
    views=NUM_VIEWS,
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
from pipelines.batch import BatchOptions
from pipelines.configs import InferConfig
from pipelines.formats.grasps_stream import read_index

frames, out = map(Path, sys.argv[1:])
started = time.perf_counter()
infer.run(infer.InferPaths(frames, out), InferConfig(), BatchOptions(progress=False))
seconds = time.perf_counter() - started
peak = next(line for line in Path("/proc/self/status").read_text().splitlines() if "VmHWM" in line)
print(len(read_index(out).names), seconds, peak.split()[1])
"""


def measure() -> list[Measurement]:
    """Return speed and peak memory of one process; nothing where the system does not say."""
    note = f"of {NUM_OBJECTS} objects, 640 x 480, all cores, start included"
    if not Path("/proc/self/status").is_file():
        return [Measurement("infer", None, "s/frame", f"{NUM_FRAMES} frames {note}")]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        few = _flat_tables(folder)
        lines = [*_measured(few, folder, note), *_measured(_linked(few, folder), folder, note)]
        if REAL.is_dir():
            lines += _measured(_real(folder), folder, "real, of several cameras")
    return lines


def _measured(frames: Path, folder: Path, note: str) -> list[Measurement]:
    """Return seconds a frame and peak memory of `infer` on the folder `frames`."""
    out = folder / f"{len(list(folder.iterdir()))}.h5"
    command = [sys.executable, "-c", CHILD, frames, out]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    count, seconds, kilobytes = text.split()
    said = f"{count} frames, {note}"
    return [
        Measurement("infer", float(seconds) / int(count), "s/frame", said),
        Measurement("infer, peak memory", float(kilobytes) / 1024.0, "MB", said),
    ]


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
    """Return a folder in which the frames of `few` stand as often as makes `NUM_FRAMES`."""
    many = folder / "many"
    many.mkdir()
    for number in range(NUM_FRAMES // (NUM_SCENES * NUM_VIEWS)):
        for source in sorted(few.rglob("*_*.*")):
            scene = source.parent.parent.name
            os.link(source, many / f"{number:02d}_{scene}_{source.name}")
    return many
