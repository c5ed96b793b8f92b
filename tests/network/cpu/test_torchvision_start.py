"""torchvision is imported without torch's compiler, which is there for who uses it."""

import subprocess
import sys

import pytest

LEFT_OUT = """
import sys
import pipelines.network.detection.detector
assert "torchvision" in sys.modules
assert not [name for name in sys.modules if name.startswith("torch._dynamo")]
"""
ASKED_BY_TORCHVISION = (
    LEFT_OUT
    + """
asked = sys.modules["torchvision.ops.roi_align"].is_compile_supported("cpu")
import torch._dynamo.utils
assert torch._dynamo.utils.__file__.endswith("utils.py")
assert asked == torch._dynamo.utils.is_compile_supported("cpu")
"""
)
COMPILES = (
    LEFT_OUT
    + """
import torch
doubled = torch.compile(lambda x: 2 * x + 1, backend="eager")
assert doubled(torch.ones(2)).tolist() == [3.0, 3.0]
assert torch._dynamo.utils is sys.modules["torch._dynamo.utils"]
"""
)
LOADED_BEFORE = """
import sys
import torch._dynamo.utils as before
import pipelines.network.detection.detector
assert sys.modules["torch._dynamo.utils"] is before
assert sys.modules["torchvision.ops.roi_align"].is_compile_supported is before.is_compile_supported
"""
WANTED_MEANWHILE = (
    LOADED_BEFORE
    + """
from pipelines.network.cpu import torchvision_start as start
stand_in = sys.modules[start.COMPILER] = start._StandIn(start.COMPILER)
assert not hasattr(stand_in, "__file__") and sys.modules[start.COMPILER] is stand_in
assert callable(stand_in.counters.clear)
assert sys.modules[start.COMPILER].__file__.endswith("utils.py")
"""
)


# One that asks the compiler for nothing, and a torch without that module.
ANOTHER_TORCHVISION = """
import sys, types
from importlib.machinery import ModuleSpec
import torch

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "torch._dynamo.utils":
            raise ModuleNotFoundError(name)
        return ModuleSpec(name, self) if name == "torchvision" else None

    def create_module(self, spec):
        return types.ModuleType(spec.name)

    def exec_module(self, module):
        pass

sys.meta_path.insert(0, Finder())
import pipelines.network
assert "torchvision" in sys.modules and "torch._dynamo.utils" not in sys.modules
"""


@pytest.mark.parametrize(
    "program",
    [
        ASKED_BY_TORCHVISION,
        COMPILES,
        WANTED_MEANWHILE,
        ANOTHER_TORCHVISION,
    ],
)
def test_the_compiler_is_loaded_for_who_uses_it_alone(program):
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
