"""The same bytes under all conditions: `python -m tests.stages.conditions INPUTS --trace`.

Each command runs once as a reference and once under each condition: workers, hash seed, time zone,
locale, threads. With --trace it runs once more under strace, which records the connections of
all its processes.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from tests.stages.interruption import COMMANDS, LONGEST_RUN, ROOT, digests, write_inputs

# Commands that read the output of an earlier command of the same line.
CHAINS = COMMANDS | {
    "labels": f"synthesize {COMMANDS['synthesize']}; annotate-symmetry {{out}}/root --workers 2; "
    "refine-grasps {out}/root --workers 2; pack {out}/root --out {out}/packed --workers 2; "
    "export-coco {out}/root --out {out}/coco --workers 2",
    "frames": "convert-frames {root} --out {out}/pairs; infer {out}/pairs --out {out}/g.h5 "
    "--overlays {out}/pictures --regions geometric --method planar --workers 2; "
    "view {out}/g.h5 --out {out}/view --workers 2; export {out}/g.h5 --to json --out {out}/g.json; "
    "export {out}/g.h5 --to csv --out {out}/g.csv; workspace {out}/pairs --out {out}/workspace",
    "judged": f"evaluate {COMMANDS['evaluate']}; infer {COMMANDS['infer']}; "
    "evaluate {out}/g.h5 --dataset {root} --out {out}/planar.json --workers 2; "
    "compare report.json planar.json --out compared.json; "  # it holds these paths
    "export {grasps} --to graspnet --out {out}/dump; "
    "evaluate {out}/dump --dataset {root} --protocol graspnet --out {out}/ap.json --workers 2; "
    "score-grasps {meshes}/can.ply {out}/dump/scene_0100/realsense/0000.npy --out {out}/scores.npz",
    "critic": "train-critic planes {root} --calibrate {held} --out {out}/c.safetensors --epochs 1 "
    "--threads 1 --set infer.regions=geometric --workers 2; inspect {root}",
    "gripper": "gripper from-urdf {hand} --out {out}/g.toml; "
    "gripper check {out}/g.toml --picture {out}/checked.png",
    "doctor": "doctor",
}
REFERENCE = {"PYTHONHASHSEED": "0", "TZ": "UTC", "LC_ALL": "C.UTF-8", "OMP_NUM_THREADS": "1"}
CONDITIONS: Mapping[str, Mapping[str, str]] = {
    "1 worker": {"workers": "1"},
    "4 workers": {"workers": "4"},
    "another hash seed": {"PYTHONHASHSEED": "4711"},
    "Kathmandu's time": {"TZ": "Asia/Kathmandu"},
    "an ASCII locale": {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    "a Turkish locale": {"LC_ALL": "tr_TR.UTF-8"},
    "4 threads": {"OMP_NUM_THREADS": "4", "OPENBLAS_NUM_THREADS": "4", "NUMBA_NUM_THREADS": "4"},
}
REMOTE = re.compile(r"(connect|sendto|sendmsg)\(.*sa_family=AF_INET6?,(?!.*\"(127\.|::1))")


def run(name, inputs, out, condition, before=()):
    """Run the commands `name` with outputs in `out`; return the failure, or an empty text."""
    condition = dict(condition)
    workers = condition.pop("workers", "2")
    places = {"out": out, "grasps": inputs / "grasps.h5"}
    places |= {each: inputs / each for each in ("root", "held", "packed", "meshes")}
    places["hand"] = inputs / "hand.urdf"
    surroundings = os.environ | REFERENCE | condition | {"PYTHONPATH": str(ROOT)}
    for line in CHAINS[name].format(**places).split("; "):
        words = line.replace("--workers 2", f"--workers {workers}").split()
        stage = [] if ";" in CHAINS[name] or name == "doctor" else name.split()
        done = subprocess.run(
            [*before, sys.executable, "-m", "symgrasp", *stage, *words],
            cwd=out, env=surroundings, capture_output=True, text=True, errors="replace",
            timeout=LONGEST_RUN, check=False,
        )  # fmt: skip
        if done.returncode != 0:
            return f"{' '.join(words[:2])} ended with {done.returncode}: {done.stderr[-500:]}"
        if words[0] == "inspect":
            (out / "inspect.txt").write_text(done.stdout, encoding="utf-8")
    return ""


def written(name, inputs, condition):
    """Return the digests of the outputs of the commands `name`, or the failure."""
    with tempfile.TemporaryDirectory() as folder:
        failed = run(name, inputs, Path(folder), condition)
        return failed or digests(Path(folder))


def connections(name, inputs):
    """Return the calls of the commands `name` that reach another machine."""
    with tempfile.TemporaryDirectory() as folder:
        log, out = Path(folder) / "calls", Path(folder) / "outputs"
        out.mkdir()
        tracer = "strace", "-f", "-qq", "-A", "-e", "trace=%network", "-o", str(log)
        failed = run(name, inputs, out, {}, tracer)
        calls = log.read_text(errors="replace").splitlines()
        return [failed] if failed else [call for call in calls if REMOTE.search(call)]


def differing(reference, other):
    """Return the names of the files that differ, or the failure."""
    if isinstance(other, str):
        return other
    names = sorted(reference.keys() | other.keys())
    return ", ".join(name for name in names if reference.get(name) != other.get(name))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("inputs", type=Path, help="folder of inputs, written if it does not exist")
    parser.add_argument("--stages", default=",".join(CHAINS))
    parser.add_argument("--conditions", default=",".join(CONDITIONS))
    parser.add_argument("--trace", action="store_true", help="count connections, with strace")
    given = parser.parse_args()
    given.inputs = given.inputs.resolve()
    if not given.inputs.exists():
        write_inputs(given.inputs)
    wrong = 0
    for name in given.stages.split(","):
        reference = written(name, given.inputs, {})
        if isinstance(reference, str):
            sys.exit(f"{name}: {reference}")
        found = {
            each: differing(reference, written(name, given.inputs, CONDITIONS[each]))
            for each in given.conditions.split(",")
            if each
        }
        if given.trace:
            found["connections"] = "; ".join(connections(name, given.inputs))
        wrong += sum(map(bool, found.values()))
        differs = {each: names for each, names in found.items() if names} or "the same"
        sys.stdout.write(f"{name}: {len(reference)} files, {len(found)} conditions: {differs}\n")
        sys.stdout.flush()
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
