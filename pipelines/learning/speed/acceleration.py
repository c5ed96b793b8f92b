"""Faster steps for GPUs, on request: products in bfloat16, chains of layers compiled.

Only the copies of a module that gradients are computed on are changed: what is validated and kept
is the float32 module. Products of matrices and convolutions of `MIN_WIDTH` channels and more run
in bfloat16; sums of losses, norms, coordinates and the narrow layers that take them in or give
them out stay in float32, for bfloat16 would move a point at 10 cm by a fifth of a millimetre.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, cast

from torch import Tensor, nn

from pipelines.errors import SymgraspError, UnknownNameError
from pipelines.network.heads import Heads
from pipelines.network.pift import PIFT, ConvolutionPIFT

PRECISIONS = ("float32", "bf16")
MIN_WIDTH = 16
MOST_VARIANTS = 200  # chains, and sizes of what they are given, that are compiled


class _HalfLinear(nn.Linear):
    def forward(self, features: Tensor) -> Tensor:
        bias = None if self.bias is None else self.bias.bfloat16()
        made = nn.functional.linear(features.bfloat16(), self.weight.bfloat16(), bias)
        return made.float()


class _HalfConv(nn.Conv2d):
    def forward(self, features: Tensor) -> Tensor:
        bias = None if self.bias is None else self.bias.bfloat16()
        weight, (stride, padding) = self.weight.bfloat16(), (self.stride, self.padding)
        made = nn.functional.conv2d(
            features.bfloat16(), weight, bias, stride, padding, self.dilation, self.groups
        )
        return made.float()


@dataclass(frozen=True)
class Acceleration:
    """How the copies of a module that gradients are computed on differ from it.

    Attributes:
        precision: float32 or bf16.
        compiled: whether chains of layers are compiled.
        backend: torch.compile's.
    """

    precision: str = "float32"
    compiled: bool = False
    backend: str = "inductor"

    def __post_init__(self) -> None:
        if self.precision not in PRECISIONS:
            raise UnknownNameError("precision", self.precision, PRECISIONS)

    def apply(self, module: nn.Module) -> nn.Module:
        """Change `module` itself; return it."""
        if self.precision == "bf16":
            for layer in _wide_layers(module):
                # The class alone decides how a layer is worked out; its tensors stay shared.
                layer.__class__ = _HalfLinear if isinstance(layer, nn.Linear) else _HalfConv
        if self.compiled:
            from torch._dynamo import config  # noqa: PLC0415 - slow to import

            # To the compiler all chains are one function; at its own limit the others stay plain.
            config.recompile_limit = max(config.recompile_limit, MOST_VARIANTS)
            for chain in _chains(module):
                cast(Any, chain).compile(backend=self.backend)
        return module

    @contextmanager
    def guarded(self) -> Iterator[None]:
        """Say in a sentence that compiling does not work here, where it does not."""
        if not self.compiled:
            yield
            return
        from torch._dynamo.exc import TorchDynamoException  # noqa: PLC0415 - slow to import

        try:
            yield
        except TorchDynamoException as error:  # a GPU too old, or without Triton, among them
            first = str(error).strip().splitlines()[0]
            raise SymgraspError(
                f"torch.compile does not work here ({first}); leave out --compile"
            ) from error


def _wide_layers(module: nn.Module) -> Iterator[nn.Module]:
    """Yield the layers that are worth it and neither take in nor give out coordinates."""
    exact: set[int] = set()
    for part in module.modules():
        if isinstance(part, PIFT | ConvolutionPIFT):
            exact |= {id(layer) for layer in part.modules()}
        elif isinstance(part, Heads):
            exact |= {id(cast(nn.Sequential, chain)[-1]) for chain in part.children()}
    for layer in module.modules():
        plain = type(layer) in {nn.Linear, nn.Conv2d} and id(layer) not in exact
        if plain and min(cast(Tensor, layer.weight).shape[:2]) >= MIN_WIDTH:
            yield layer


def _chains(module: nn.Module) -> Iterator[nn.Module]:
    """Yield the outermost chains of layers: no sampling, no shapes that depend on values."""
    for child in module.children():
        if isinstance(child, nn.Sequential):
            yield child
        else:
            yield from _chains(child)
