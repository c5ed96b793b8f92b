"""Linear layers without gradients on a CPU, by the library that is fastest on the processor.

torch computes products of matrices by MKL, which has half of the possible speed on processors that
are not Intel's, and convolutions by oneDNN, which is fast on all processors. A linear layer is a
1 x 1 convolution; oneDNN adds the bias and applies the ReLU in the same pass.
"""

import torch
from torch import Tensor
from torch.nn import functional

from pipelines.network import devices
from pipelines.network.cpu.twins import faster_by, works


def by_onednn(
    rows: Tensor,  # (n, c)
    weight: Tensor,  # (d, c)
    bias: Tensor | None = None,  # (d,)
    rectifies: bool = False,
) -> Tensor:
    """Return the result of `linear`, by a private function of torch that its compiler uses too."""
    after = "relu" if rectifies else "none"
    made: Tensor = torch.ops.mkldnn._linear_pointwise(rows, weight, bias, after, [], "")
    return made


def _probe() -> None:
    """Linear layers by oneDNN."""
    rows, weight = torch.arange(6.0).view(2, 3), torch.arange(12.0).view(4, 3) - 6.0
    expected = functional.linear(rows, weight, torch.ones(4)).relu()
    if not torch.allclose(by_onednn(rows, weight, torch.ones(4), rectifies=True), expected):
        raise RuntimeError("results differ from torch's own")


def _is_for_onednn(
    rows: Tensor, weight: Tensor, bias: Tensor | None = None, rectifies: bool = False
) -> bool:
    del weight, bias, rectifies
    return (
        rows.dtype is torch.float32
        and devices.on_cpu(rows)
        and len(rows) > 0
        and not torch.is_grad_enabled()
        and torch.backends.mkldnn.is_available()  # type: ignore[no-untyped-call]
        and works(_probe)
    )


@faster_by(by_onednn, _is_for_onednn)
def linear(
    rows: Tensor,  # (n, c)
    weight: Tensor,  # (d, c)
    bias: Tensor | None = None,  # (d,)
    rectifies: bool = False,
) -> Tensor:
    """Return rows (n, d) of W x + b, clipped at zero if the layer `rectifies`."""
    found = functional.linear(rows, weight, bias)
    return found.relu_() if rectifies else found
