"""Signals at random moments of a stage: `python -m tests.stages.interruption INPUTS --trials 20`.

A trial starts a command, sends its process a signal after a while, and checks the remains:
processes, temporary files, shared memory, the exit code. Then the command is run again, and its
files are compared with those of a run that nobody interrupted.
"""

import argparse
import hashlib
import itertools
import json
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path

import trimesh

from pipelines.dataset import object_list
from pipelines.dataset.object_list import ObjectRecord
from pipelines.storage.provenance import make_stamp
from tests.learning.packed_toys import write_packed
from tests.stages.test_gripper import URDF
from tests.stages.toy_grasp_labels import write_rects
from tests.stages.toy_root import frame_names, true_result, write_grasps, write_root

ROOT = Path(__file__).parents[2]
# Seconds for the end of a process and of all its children; more for a busy machine.
LONGEST = float(os.environ.get("SYMGRASP_LONGEST_END", "10"))
LONGEST_RUN = 600.0
SMALL_NETWORK = (
    "network.num_points=96", "network.set_points=32,16,8,4", "network.set_neighbors=8,8,8,8",
    "network.set_strides=1,1,1,1", "num_loss_points=32",
)  # fmt: skip
SMALL_DETECTOR = ("detector.min_size=96", "detector.max_size=128", "min_pixels=50")
OTHERWISE = (".checkpoint.safetensors", ".curves.png")  # files that hold seconds


def settings(assignments):
    return " ".join(f"--set {each}" for each in assignments)


COMMANDS = {
    "annotate-symmetry": "{meshes} --out {out}/symmetry --workers 2",
    "label-grasps": "{meshes} --out {out}/root --grasp-points 2 --no-sdf --workers 2",
    "pack": "{root} --out {out}/packed --split all --workers 2",
    "infer": "{root} --out {out}/g.h5 --regions geometric --method planar --workers 2",
    "infer ": "{root} --out {out}/g.h5 --workers 2",  # with the networks
    "simulate": "{grasps} --dataset {root} --out {out}/success.json --workers 2",
    "evaluate": "{grasps} --dataset {root} --out {out}/report.json --workers 2",
    "synthesize": "{out}/root --split train --scenes-per-split 2 --views 2 --objects 3 "
    "--size 160x120 --objects-per-scene 2-2 --grasp-points 2 --no-collision-labels --workers 2",
    "train": "{packed} --out {out}/n.safetensors --epochs 12 --batch-size 6 --micro-batch 3 "
    f"--device cpu --threads 1 {settings(SMALL_NETWORK)}",
    "finetune-detector": "{root} --out {out}/d.safetensors --split all --epochs 4 --batch-size 2 "
    f"--micro-batch 1 --device cpu --threads 1 --workers 2 {settings(SMALL_DETECTOR)}",
    "train-baseline": "gg-cnn {root} --out {out}/b.safetensors --split all --steps 8 "
    "--batch-size 2 --micro-batch 1 --device cpu --threads 1 --workers 2",
}
TRAININGS = ("train", "finetune-detector", "train-baseline")
# These commands run until a signal, which comes within the given seconds.
ENDLESS = {
    "infer --watch": "{root} --out {out}/g.h5 --regions geometric --method planar",
    "train --endless": "{root} {packed} --out {out}/n.safetensors --epochs 999 --batch-size 6 "
    f"--micro-batch 3 --device cpu --threads 1 --workers 2 {settings(SMALL_NETWORK)}",
    "serve": "--port {port} --set regions=geometric --set method=planar",
}
ENDLESS_SECONDS = 30.0


def write_inputs(folder):
    """Write the inputs of all commands."""
    root = write_root(folder / "root")
    write_rects(root)
    records = [ObjectRecord(i, f"object{i}", "toy", "seen") for i in range(3)]
    object_list.write(root.root / "objects.json", records, make_stamp("inputs", {}))
    write_packed(folder / "packed", scenes=4)
    write_grasps(folder / "grasps.h5", [true_result(root, name) for name in frame_names()])
    (folder / "meshes").mkdir()
    shapes = {
        "box": trimesh.creation.box((0.06, 0.04, 0.1)),
        "can": trimesh.creation.cylinder(0.025, 0.08, sections=32),
        "ball": trimesh.creation.icosphere(2, 0.03),
    }
    for name, shape in shapes.items():
        shape.export(folder / "meshes" / f"{name}.ply")
    write_root(folder / "held")
    (folder / "hand.urdf").write_text(URDF)
    return folder


@dataclass
class Stage:
    """A command, its uninterrupted outputs, and the seconds it takes."""

    name: str
    inputs: Path
    seconds: float = 0.0
    files: dict[str, str] = field(default_factory=dict)

    def command(self, out, *more):
        places = {"out": out, "grasps": self.inputs / "grasps.h5", "port": free_port()}
        places |= {name: self.inputs / name for name in ("root", "packed", "meshes")}
        words = (COMMANDS | ENDLESS)[self.name].format(**places).split()
        return [sys.executable, "-m", "symgrasp", *self.name.split(), *words, *more]

    def run(self, out):
        """Run the command to its end; return its standard error."""
        is_begun = self.name in TRAININGS and list(out.glob("*.checkpoint.safetensors"))
        command = self.command(out, *(["--resume"] if is_begun else []))
        began = time.monotonic()
        done = subprocess.run(
            command, cwd=ROOT, capture_output=True, text=True, timeout=LONGEST_RUN, check=False
        )
        taken = time.monotonic() - began  # the first run may compile loops
        self.seconds = min(self.seconds or taken, taken)
        assert done.returncode == 0, f"{self.name}: {done.stderr}"
        return done.stderr

    def refer(self):
        """Run the command undisturbed, in a folder as deep as the trials': files contain paths."""
        with tempfile.TemporaryDirectory() as folder:
            self.run(Path(folder))
            self.files = digests(Path(folder))
        return self


def free_port():
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


def digests(folder):
    """Return the digests of the files that are the same in each run, by path."""
    paths = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in paths
        if not path.name.endswith(OTHERWISE) and ".logs" not in str(path.parent)
    }


@dataclass
class Outcome:
    """The end of an interrupted run: exit code, standard error, seconds, and the faults."""

    code: int
    stderr: str
    seconds: float
    wrong: list[str]


def trial(stage, number, moment, *, again, to_group=False):
    """Interrupt a run of `stage` after `moment` seconds, and run it `again`."""
    with tempfile.TemporaryDirectory() as name:
        out = Path(name)
        outcome = interrupted(stage.command(out), number, moment, to_group=to_group)
        wrong = outcome.wrong
        if number != signal.SIGKILL:
            wrong += hidden(out)
            is_training = f"stopped by {signal.Signals(number).name} after" in outcome.stderr
            if is_training and not list(out.glob("*.checkpoint.safetensors")):
                wrong.append("no checkpoint")
        if again:
            try:
                stage.run(out)
                wrong += [] if digests(out) == stage.files else ["other bytes"]
            except AssertionError as error:
                wrong.append(f"again: {error}")
            wrong += hidden(out)
    return outcome


def interrupted(command, number, moment, *, to_group):
    """Run `command`, send it or its group a signal, and return its end and remains."""
    pipe, nothing = subprocess.PIPE, subprocess.DEVNULL
    process = subprocess.Popen(
        command, cwd=ROOT, stdout=nothing, stderr=pipe, text=True, start_new_session=True
    )
    time.sleep(moment)
    (os.killpg if to_group else os.kill)(process.pid, number)
    began, wrong = time.monotonic(), []
    if not wait_for(lambda: process.poll() is not None):
        wrong.append("alive")
    seconds = time.monotonic() - began
    if not wrong and not wait_for(lambda: not has_processes(process.pid)):
        wrong.append("children alive")
    if has_processes(process.pid):
        os.killpg(process.pid, signal.SIGKILL)
    stderr, code = process.communicate()[1], process.returncode
    # Errors in the start of the interpreter, before our first instruction, do not count.
    if not (code == -number or "init_import_site" in stderr):
        wrong += [word for word in ("Traceback", "Warning") if word in stderr]
        wrong += [] if code in {0, 128 + number} else [f"exit code {code}"]
    wrong += [f"{each.name} is left" for each in shared_memory(process.pid)]
    return Outcome(code, stderr, seconds, wrong)


def wait_for(condition):
    began = time.monotonic()
    while time.monotonic() - began < LONGEST:
        if condition():
            return True
        time.sleep(0.1)
    return False


def has_processes(group):
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def shared_memory(process):
    names = (f"-{process}-", f"_{process}_")
    folder = Path("/dev/shm")
    return [path for path in folder.iterdir() if any(each in path.name for each in names)]


def hidden(folder):
    return [f"{path.name} is left" for path in folder.rglob(".*")]


def many(inputs, log, stages, numbers, trials, start_up, seed):
    """Make many trials; print counts and append each trial to `log`."""
    rng, counts = random.Random(seed), Counter()
    is_whole = {name: not start_up and name not in ENDLESS for name in stages}
    tried = [
        Stage(name, inputs, 0.0 if is_whole[name] else start_up or ENDLESS_SECONDS)
        for name in stages
    ]
    for count, (number, stage) in enumerate(
        itertools.islice(itertools.cycle(itertools.product(numbers, tried)), trials)
    ):
        if is_whole[stage.name] and not stage.files:
            stage.refer()
        moment = rng.uniform(0.1, stage.seconds)
        to_group = number == signal.SIGINT and rng.random() < 0.5  # as a terminal sends it
        again = is_whole[stage.name] and (number == signal.SIGKILL or rng.random() < 0.2)
        outcome = trial(stage, number, moment, again=again, to_group=to_group)
        kind = signal.Signals(number).name
        counts[kind, "wrong" if outcome.wrong else "right"] += 1
        counts[kind, outcome.code] += 1
        record = {"stage": stage.name, "signal": kind, "moment": moment, "group": to_group}
        record |= {"again": again, **asdict(outcome)}
        with log.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(record) + "\n")
        counts["seconds at most"] = max(counts["seconds at most"], round(outcome.seconds, 1))
        sys.stdout.write(f"{count + 1} {dict(counts)} {outcome.wrong or ''}\n")
        sys.stdout.flush()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("inputs", type=Path, help="folder of inputs, written if it does not exist")
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument("--log", type=Path, default=Path("trials.jsonl"))
    parser.add_argument("--stages", default=",".join(COMMANDS))
    parser.add_argument("--signals", default="SIGTERM,SIGINT,SIGKILL")
    parser.add_argument("--start-up", type=float, help="seconds to sweep, nothing runs again")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    if not given.inputs.exists():
        write_inputs(given.inputs)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # children of `&` ignore it
    numbers = [signal.Signals[each] for each in given.signals.split(",")]
    stages = given.stages.split(",")
    many(given.inputs, given.log, stages, numbers, given.trials, given.start_up, given.seed)


if __name__ == "__main__":
    main()
