"""Devices of tensors: `auto`, `cpu`, `cuda` or `cuda:N`."""

import torch
from torch import Tensor

from pipelines.errors import ValueRangeError
from pipelines.runtime.device_names import check_device_name


def find_device(name: str, process: int | None = None) -> torch.device:
    """Return the device called `name`; `auto` is a GPU if there is one, else the CPU.

    `process`: number of the calling process on this machine; `auto` and `cuda` take this GPU.

    Raises:
        UnknownNameError: `name` is unknown.
        ValueRangeError: there is no such GPU.
    """
    check_device_name(name, "device")
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    kind, _, number = name.partition(":")
    if kind == "cuda" and not number and process is not None:
        number, name = str(process), f"cuda:{process}"
    if kind == "cuda" and int(number or 0) >= torch.cuda.device_count():
        found = [f"cuda:{place}" for place in range(torch.cuda.device_count())]
        known = " or ".join(["cpu", *found])
        raise ValueRangeError("--device", name, f"{known} on this machine")
    return torch.device(name)


def on_cpu(tensor: Tensor) -> bool:
    """Return whether `tensor` is in the memory of the CPU.

    Layers call this as `devices.on_cpu`, which tests replace to run the code for GPUs on a CPU.
    """
    return tensor.device.type == "cpu"
