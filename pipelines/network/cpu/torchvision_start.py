"""torchvision, imported without torch's compiler.

torchvision asks `torch._dynamo.utils` on import for a function that it calls only where training
on a GPU must be deterministic. That module brings the whole compiler with it: two of the seven
seconds and a tenth of the memory that a process of `infer` takes to start.
"""

import importlib
import sys
from types import ModuleType
from typing import Any

COMPILER = "torch._dynamo.utils"


class _StandIn(ModuleType):
    """Stands in for the compiler's module, and fetches it for whoever wants more than the name."""

    @staticmethod
    def is_compile_supported(device: Any) -> Any:  # noqa: ANN401 - as torch's
        """Return what torch's function of this name does."""
        return _real().is_compile_supported(device)

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whatever torch has there
        if name.startswith("__"):  # `inspect` asks every module for its file
            raise AttributeError(name)
        return getattr(_real(), name)


def import_torchvision() -> None:
    """Import torchvision, if nobody has; the compiler then waits for who uses it."""
    if "torchvision" in sys.modules or COMPILER in sys.modules:
        return
    sys.modules[COMPILER] = _StandIn(COMPILER)
    try:
        importlib.import_module("torchvision")
    finally:
        _withdraw()


def _real() -> ModuleType:
    """Return torch's own module."""
    _withdraw()
    return importlib.import_module(COMPILER)


def _withdraw() -> None:
    if isinstance(sys.modules.get(COMPILER), _StandIn):
        del sys.modules[COMPILER]
