"""Import of torchvision without torch's compiler.

torchvision imports a function of `torch._dynamo.utils` that it calls only if training on a GPU must
be deterministic. That module imports the whole compiler: two of the seven seconds and a tenth of
the memory that a process of `infer` takes to start. A release of torch without this module works
unchanged, since torchvision then does not import it.
"""

import importlib
import sys
from types import ModuleType
from typing import Any

COMPILER = "torch._dynamo.utils"


class _StandIn(ModuleType):
    """A substitute for the compiler's module, which fetches the module when it is used."""

    @staticmethod
    def is_compile_supported(device: Any) -> Any:  # noqa: ANN401 - as torch's
        """Call torch's function of this name."""
        return _real().is_compile_supported(device)

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whatever torch has there
        if name.startswith("__"):  # `inspect` asks every module for its file
            raise AttributeError(name)
        return getattr(_real(), name)


def import_torchvision() -> None:
    """Import torchvision unless it is imported; the compiler is imported at its first use."""
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
