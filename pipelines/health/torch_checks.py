"""Checks that torch and torchvision compute correct results, on the CPU and on each GPU."""

import shutil
import subprocess
from collections.abc import Iterator
from functools import partial

from pipelines.health.checks import Check, Status, guarded

SIDE = 512  # of the matrices that are multiplied
SMI_SECONDS = 10


def operator_check(device: str = "cpu") -> Check:
    """Run torchvision's compiled operators on boxes whose answers are known."""
    import torch  # noqa: PLC0415 - slow to load
    from torchvision.ops import nms, roi_align  # noqa: PLC0415

    name = "operators" if device == "cpu" else f"operators {device}"
    boxes = torch.tensor([[0.0, 0, 10, 10], [1, 1, 11, 11], [20, 20, 30, 30]], device=device)
    scores = torch.tensor([0.9, 0.8, 0.7], device=device)
    # The first two boxes have an intersection over union of 0.68.
    if nms(boxes, scores, 0.5).tolist() != [0, 2]:
        return Check(name, Status.FAIL, "torchvision's nms keeps the wrong boxes; install it again")
    y, x = torch.meshgrid(torch.arange(8.0), torch.arange(8.0), indexing="ij")
    region = torch.tensor([[0.0, 1, 1, 5, 5]], device=device)
    # On a linear slope, each cell's mean is the value at the cell's middle.
    found = roi_align((x + 10 * y)[None, None].to(device), region, 2, aligned=True)[0, 0].cpu()
    if not torch.allclose(found, torch.tensor([[16.5, 18.5], [36.5, 38.5]])):
        return Check(name, Status.FAIL, "torchvision's roi_align is wrong; install it again")
    return Check(name, Status.OK, "torchvision's nms and roi_align give correct results")


def gpu_checks(max_error: float) -> Iterator[Check]:
    """Report the GPUs, and compare a product of matrices on each GPU with the CPU's.

    `max_error`: the largest difference, relative to the largest number of the product.
    """
    import torch  # noqa: PLC0415 - slow to load

    if not torch.cuda.is_available():
        yield _without_gpu()
        return
    drivers = _smi("driver_version") or ["unknown"]
    for number in range(torch.cuda.device_count()):
        device = f"cuda:{number}"
        yield guarded(f"gpu {number}", partial(product_check, device, drivers[0], max_error))
        yield guarded(f"operators {device}", partial(operator_check, device))


def devices() -> list[str]:
    """Return the devices that networks can run on: the CPU, and the first GPU if there is one."""
    import torch  # noqa: PLC0415 - slow to load

    return ["cpu", "cuda"] if torch.cuda.is_available() else ["cpu"]


def product_check(device: str, driver: str, max_error: float) -> Check:
    """Compare a product of matrices on `device` with the CPU's in double precision."""
    import torch  # noqa: PLC0415 - slow to load

    properties = torch.cuda.get_device_properties(device)
    about = f"{properties.name}, driver {driver}, CUDA {torch.version.cuda}"
    about += f", {properties.total_memory / 1e9:.0f} GB"
    error = product_error(device)
    name = f"gpu {device.partition(':')[2]}"
    if not error <= max_error:
        wrong = f"{about}; its products differ from the CPU's by {error:.1e}; use --device cpu"
        return Check(name, Status.FAIL, wrong)
    return Check(name, Status.OK, f"{about}; a product of matrices agrees with the CPU's")


def product_error(device: str) -> float:
    """Return the error of a product of matrices, relative to its largest number."""
    import torch  # noqa: PLC0415 - slow to load

    generator = torch.Generator().manual_seed(0)
    one, other = torch.randn(2, SIDE, SIDE, generator=generator)
    expected = one.double() @ other.double()
    found = (one.to(device) @ other.to(device)).cpu().double()
    return float((found - expected).abs().max() / expected.abs().max())


def _without_gpu() -> Check:
    import torch  # noqa: PLC0415 - slow to load

    names = _smi("name,driver_version")
    if not names:
        return Check("gpu", Status.OK, "none, the CPU is used")
    built = f"CUDA {torch.version.cuda}" if torch.version.cuda else "the CPU alone"
    return Check(
        "gpu",
        Status.WARN,
        f"{names[0]} is there, but torch {torch.__version__}, built for {built}, cannot use it; "
        "the CPU is used; install a torch for the driver to use the GPU",
    )


def _smi(query: str) -> list[str]:
    """Return nvidia-smi's answer for each GPU; nothing without the tool or a GPU."""
    tool = shutil.which("nvidia-smi")
    if tool is None:
        return []
    command = [tool, f"--query-gpu={query}", "--format=csv,noheader"]
    try:
        said = subprocess.run(
            command, capture_output=True, text=True, timeout=SMI_SECONDS, check=True
        )
    except (OSError, subprocess.SubprocessError):  # nvidia-smi fails without a driver
        return []
    return [line.strip() for line in said.stdout.splitlines() if line.strip()]
