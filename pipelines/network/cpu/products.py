"""Linear layers without gradients on a CPU, by the library that makes the most of the processor.

torch leaves products of matrices to MKL, which uses half of what processors of other makers than
its own can do, and convolutions to oneDNN, which does not ask who made them. A linear layer is
a 1 x 1 convolution; with oneDNN bias and ReLU come in the same pass.
"""

import torch
from torch import Tensor
from torch.nn import functional

from pipelines.network import devices


def linear(
    rows: Tensor,  # (n, c)
    weight: Tensor,  # (d, c)
    bias: Tensor | None = None,  # (d,)
    rectifies: bool = False,
) -> Tensor:
    """Return rows (n, d) of W x + b; where it `rectifies`, nothing below zero is left."""
    if _is_for_onednn(rows):
        after = "relu" if rectifies else "none"
        made: Tensor = torch.ops.mkldnn._linear_pointwise(rows, weight, bias, after, [], "")
        return made
    found = functional.linear(rows, weight, bias)
    return found.relu_() if rectifies else found


def _is_for_onednn(rows: Tensor) -> bool:
    return (
        rows.dtype is torch.float32
        and devices.on_cpu(rows)
        and len(rows) > 0
        and torch.backends.mkldnn.is_available()  # type: ignore[no-untyped-call]
        and not torch.is_grad_enabled()
    )
