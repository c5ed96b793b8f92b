"""Compiled loops: kept nowhere they still work, and a frame has none of them compiled twice."""

import subprocess
import sys

import numpy as np

from pipelines.geometry.compiled import compiled

# In a process of its own: other tests may call the same loops with other kinds of arguments.
GOLDEN_FRAME = """
import sys
from numba.core.dispatcher import Dispatcher
from pipelines.formats.weights_manifest import read_manifest
from pipelines.health.golden import golden_result
from pipelines.inference.models import WEIGHTS

golden_result(read_manifest(WEIGHTS / "manifest.json").frame)
for name, module in sorted(sys.modules.items()):
    for function in vars(module).values() if name.startswith("pipelines.") else ():
        if isinstance(function, Dispatcher) and function.__module__ == name:
            print(f"{name}.{function.__name__}", len(function.signatures))
"""


def test_a_loop_that_cannot_be_kept_is_compiled_all_the_same():
    namespace = {}
    exec("def total(values):\n    return values.sum()", namespace)  # of no file
    assert compiled(namespace["total"])(np.arange(4.0)) == 6.0


def test_a_frame_needs_each_loop_for_one_kind_of_arguments():
    made = subprocess.run(
        [sys.executable, "-c", GOLDEN_FRAME], capture_output=True, text=True, check=True
    )
    counts = dict(line.split() for line in made.stdout.splitlines())
    assert "pipelines.grasping.hand_bodies.points_met" in counts
    assert {name: number for name, number in counts.items() if int(number) > 1} == {}
