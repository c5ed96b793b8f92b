"""The operations of a network's products, those included that torch's own counter does not know."""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch.utils.flop_counter import FlopCounterMode


def gflop_of(step: Callable[[], object]) -> float:
    """Return the operations of `step` without gradients, in this thread, in thousand millions."""
    with torch.no_grad(), FlopCounterMode(display=False, custom_mapping=_COUNTED) as counter:
        step()
    return counter.get_total_flops() / 1e9


def _linear_flops(rows: Sequence[int], weight: Sequence[int], *_: object, **__: object) -> int:
    """Return the operations of a linear layer, from the shapes of its first two arguments."""
    return 2 * int(np.prod(rows)) * weight[0]


def _linear_by_onednn() -> dict[object, Callable[..., int]]:
    """Return the counter of the private linear layer of torch, where there is one."""
    operation = getattr(torch.ops.mkldnn, "_linear_pointwise", None)
    return {} if operation is None else {operation: _linear_flops}


_COUNTED = _linear_by_onednn()
