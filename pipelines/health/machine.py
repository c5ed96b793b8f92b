"""Cores, memory and disk of this machine that this process may use."""

import os
import re
import shutil
from pathlib import Path

from pipelines.health.checks import Check, Status

MEMORY_INFO = Path("/proc/meminfo")
CONTROL_GROUP = Path("/sys/fs/cgroup")
INACTIVE = re.compile(r"inactive_file \d")
GIGA = 1e9


def cores_check() -> Check:
    """Report how many cores this process may use."""
    from joblib import cpu_count  # noqa: PLC0415 - may be broken

    usable, present = cpu_count(), os.cpu_count() or 1
    text = f"{usable} usable" if usable == present else f"{usable} of {present} usable"
    threads = os.environ.get("OMP_NUM_THREADS")
    return Check("cores", Status.OK, text + (f"; OMP_NUM_THREADS={threads}" if threads else ""))


def rays_check() -> Check:
    """Report which search casts the rays."""
    from pipelines.geometry.meshes.ray_search import has_embree  # noqa: PLC0415 - may be broken

    slower = "by a tree of boxes, without embreex: two to five times slower, the same hits"
    return Check("rays", Status.OK, "by Embree" if has_embree() else slower)


def memory_check(least: float) -> Check:
    """Report the free memory; warn below `least` bytes."""
    free = free_memory()
    if free is None:
        return Check("memory", Status.OK, "this system does not report the free memory")
    text = f"{free / GIGA:.1f} GB free"
    if free < least:
        return Check("memory", Status.WARN, f"{text}; infer may need {least / GIGA:.0f} GB")
    return Check("memory", Status.OK, text)


def disk_check(folder: Path, least: float) -> Check:
    """Report the free space on the disk of `folder`; warn below `least` bytes."""
    free = shutil.disk_usage(folder).free
    text = f"{free / GIGA:.1f} GB free at {folder}"
    if free < least:
        return Check("disk", Status.WARN, f"{text}; results may need {least / GIGA:.0f} GB")
    return Check("disk", Status.OK, text)


def free_memory(
    memory_info: Path = MEMORY_INFO, control_group: Path = CONTROL_GROUP
) -> float | None:
    """Return the available bytes, within the limit of a container; None if unknown."""
    rooms = [_available(memory_info), _left_of_limit(control_group)]
    return min((room for room in rooms if room is not None), default=None)


def _available(memory_info: Path) -> float | None:
    try:
        lines = memory_info.read_text(encoding="ascii").splitlines()
    except OSError:  # not Linux
        return None
    found = (line.split() for line in lines if line.startswith("MemAvailable:"))
    return next((float(words[1]) * 1024 for words in found), None)


def _left_of_limit(control_group: Path) -> float | None:
    try:
        limit, used, stat = (
            (control_group / name).read_text(encoding="ascii").strip()
            for name in ("memory.max", "memory.current", "memory.stat")
        )
    except OSError:  # no container, or an older kind of control groups
        return None
    # Used memory includes the cache of files that were read, which the system gives up.
    cached = next((line.split()[1] for line in stat.splitlines() if INACTIVE.match(line)), "0")
    return float(limit) - float(used) + float(cached) if limit.isdecimal() else None
