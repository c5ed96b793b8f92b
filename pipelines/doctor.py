"""Stage `doctor`: checks that this machine is ready to find grasps.

Reads   installed packages, this machine, the default weights and their manifest
Writes  nothing

Each part is checked separately: a broken part does not hide the others. So nothing is imported here
that a broken package could keep from loading.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from pipelines.configs import DoctorConfig
from pipelines.health import machine, packages, torch_checks
from pipelines.health.checks import Check, Status, guarded

STAGE = "doctor"
NETWORKS = {"torch", "torchvision"}


def run(config: DoctorConfig, *, folder: Path | None = None) -> Iterator[Check]:
    """Yield the checks, one at a time; the last checks take seconds.

    `folder`: folder for results, for the free space of its disk; the working folder if None.
    """
    needed = packages.required()
    yield packages.python_check()
    yield packages.project_check()
    failed = []
    for each in (each for each in needed if not each.extra):
        check = packages.package_check(each)
        if check.status is Status.FAIL:
            failed.append(each.name)
        yield check
    yield from packages.extra_checks([each for each in needed if each.extra])
    yield guarded("cores", machine.cores_check)
    yield guarded("rays", machine.rays_check)
    yield guarded("memory", partial(machine.memory_check, config.min_free_memory))
    yield guarded("disk", partial(machine.disk_check, folder or Path.cwd(), config.min_free_disk))
    if NETWORKS.isdisjoint(failed):
        yield guarded("operators", torch_checks.operator_check)
        yield from torch_checks.gpu_checks(config.max_product_error)
    yield from _shipped(config, failed)


def exit_code(checks: Sequence[Check]) -> int:
    """Return 1 if a check failed, else 0."""
    return int(any(check.status is Status.FAIL for check in checks))


def _shipped(config: DoctorConfig, failed: Sequence[str]) -> Iterator[Check]:
    """Yield the checks of the weights, and of the grasps that these weights find."""
    if failed:
        why = f"not checked: {' and '.join(failed)} must be fixed first"
        yield Check("weights", Status.WARN, why)
        return
    from pipelines.health import golden  # noqa: PLC0415 - needs the packages checked above

    manifest, check = golden.manifest_check()
    yield check
    if manifest is None:
        return
    for name, digest in manifest.files.items():
        yield guarded(f"weights {Path(name).stem}", partial(golden.file_check, name, digest))
    for device in torch_checks.devices():
        look = partial(golden.golden_check, manifest, config, device)
        yield guarded(golden.title(device), look)
