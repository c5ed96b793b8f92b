"""Number of operations in a network's products, also those that torch's counter omits."""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch.utils.flop_counter import FlopCounterMode


def gflop_of(step: Callable[[], object]) -> float:
    """Return the billions of operations of `step` without gradients, in this thread."""
    with torch.no_grad(), FlopCounterMode(display=False, custom_mapping=_COUNTED) as counter:
        step()
    return counter.get_total_flops() / 1e9


def _linear_flops(rows: Sequence[int], weight: Sequence[int], *_: object, **__: object) -> int:
    """Return the number of operations of a linear layer from its arguments' shapes."""
    return 2 * int(np.prod(rows)) * weight[0]


def _linear_by_onednn() -> dict[object, Callable[..., int]]:
    """Return the counter of torch's private linear layer, if there is one."""
    operation = getattr(torch.ops.mkldnn, "_linear_pointwise", None)
    return {} if operation is None else {operation: _linear_flops}


_COUNTED = _linear_by_onednn()
