"""Compiled loops: one short compilation per frame, from one file, also without a cache."""

import ast
import subprocess
import sys
from pathlib import Path

import numpy as np

import pipelines
from pipelines.geometry.numerics.compiled import compiled

PIPELINES = Path(pipelines.__file__).parent

# In a separate process: other tests may call the same loops with other argument types.
GOLDEN_FRAME = """
import sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from pipelines.storage.weights_manifest import read_manifest
from pipelines.health.golden import golden_result
from pipelines.inference.models import WEIGHTS

golden_result(read_manifest(WEIGHTS / "manifest.json").frame)
for name, module in sorted(sys.modules.items()):
    for function in vars(module).values() if name.startswith("pipelines.") else ():
        if isinstance(function, Dispatcher) and function.__module__ == name:
            folder, files = function.stats.cache_path, function._cache._cache_file._load_index()
            code = [(Path(folder) / each).read_bytes() for each in files.values()]
            handles_text = any(b"unicode" in each for each in code)
            print(f"{name}.{function.__name__}", len(function.signatures), handles_text)
"""


def test_a_loop_that_cannot_be_cached_is_compiled_too():
    namespace = {}
    exec("def total(values):\n    return values.sum()", namespace)  # of no file
    assert compiled(namespace["total"])(np.arange(4.0)) == 6.0


SAYS = """
import numba
from pipelines.geometry.numerics.compiled import compiled

numba.njit(lambda x: x)(1)
print("a user's own")


def twice(x):
    return 2 * x


twice.__module__ = "pipelines.geometry.somewhere"
doubled = compiled(twice)
doubled(1), doubled(1.0)
"""


def test_only_the_first_compilation_prints_a_message(tmp_path):
    script = tmp_path / "says.py"
    script.write_text(SAYS, encoding="utf-8")
    made = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert made.stderr.count("\n") == 1
    assert "first use of this command after an installation" in made.stderr


def test_a_frame_compiles_each_loop_once_and_no_text():
    for _ in range(2):  # a process that compiles lists the types of loops' inner calls as well
        made = subprocess.run(
            [sys.executable, "-c", GOLDEN_FRAME], capture_output=True, text=True, check=True
        )
    loops = [line.split() for line in made.stdout.splitlines()]
    assert "pipelines.grasping.feasibility.gripper_bodies.points_met" in {row[0] for row in loops}
    assert [row for row in loops if int(row[1]) > 1] == []
    # Assigned arrays and numba's solver include messages with text, which compile for seconds.
    assert [row[0] for row in loops if row[2] != "False"] == []


def names_of_other_files(tree):
    """Return the names that a module imports from the project."""
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    found = [node for node in imports if (node.module or "").startswith("pipelines")]
    return {name.asname or name.name for node in found for name in node.names}


def test_compiled_loops_use_no_names_of_other_files():
    count = 0
    for path in PIPELINES.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            marks = getattr(node, "decorator_list", [])
            if any(isinstance(mark, ast.Name) and mark.id == "compiled" for mark in marks):
                body = [name for part in node.body for name in ast.walk(part)]
                used = {name.id for name in body if isinstance(name, ast.Name)}
                assert not used & names_of_other_files(tree), f"{path}: {node.name}"
                count += 1
    assert count > 10
