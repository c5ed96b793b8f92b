"""torchvision is imported without torch's compiler, which is loaded at its first use."""

import importlib
import subprocess
import sys
from importlib.machinery import ModuleSpec
from types import ModuleType

import pytest

from pipelines.network.cpu.torchvision_start import COMPILER, import_torchvision

# One process, as the compiler can be imported only once; each step imports it later than the last.
PROGRAM = """
import sys
import pipelines.network.detection.detector
assert "torchvision" in sys.modules
assert not [name for name in sys.modules if name.startswith("torch._dynamo")]

import torch
doubled = torch.compile(lambda x: 2 * x + 1, backend="eager")
assert doubled(torch.ones(2)).tolist() == [3.0, 3.0]
real = sys.modules["torch._dynamo.utils"]
assert torch._dynamo.utils is real and real.__file__.endswith("utils.py")

from pipelines.network.cpu import torchvision_start as start
stand_in = sys.modules["torchvision.ops.roi_align"].is_compile_supported
assert stand_in is start._StandIn.is_compile_supported
assert stand_in("cpu") == real.is_compile_supported("cpu")

wanted = sys.modules[start.COMPILER] = start._StandIn(start.COMPILER)
assert not hasattr(wanted, "__file__") and sys.modules[start.COMPILER] is wanted
assert callable(wanted.counters.clear)
assert sys.modules[start.COMPILER].__file__.endswith("utils.py")
"""


class Torchvision:
    """A finder of a torchvision that calls `begin` when it is imported, without a compiler."""

    def __init__(self, begin):
        self.begin = begin

    def find_spec(self, name, path=None, target=None):
        if name == COMPILER:
            raise ModuleNotFoundError(name)
        return ModuleSpec(name, self) if name == "torchvision" else None

    def create_module(self, spec):
        return ModuleType(spec.name)

    def exec_module(self, module):
        self.begin(module)


@pytest.fixture
def installed(monkeypatch):
    """A function that replaces the real torchvision by another one."""

    def install(begin):
        for name in ("torchvision", COMPILER):
            monkeypatch.setitem(sys.modules, name, None)  # so that the real modules are restored
            del sys.modules[name]
        monkeypatch.setattr(sys, "meta_path", [Torchvision(begin), *sys.meta_path])

    return install


def ask_the_compiler(module):
    module.asked = importlib.import_module(COMPILER).is_compile_supported


def test_the_compiler_is_loaded_only_when_it_is_used():
    command = [sys.executable, "-c", PROGRAM]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_torchvision_gets_the_compiler_that_was_loaded_before(installed):
    installed(ask_the_compiler)
    before = sys.modules[COMPILER] = ModuleType(COMPILER)
    before.is_compile_supported = object()
    import_torchvision()
    assert importlib.import_module("torchvision").asked is before.is_compile_supported
    assert sys.modules[COMPILER] is before


def test_a_torchvision_that_does_not_use_the_compiler_is_imported_without_it(installed):
    installed(lambda module: None)
    import_torchvision()
    assert "torchvision" in sys.modules
    assert COMPILER not in sys.modules
