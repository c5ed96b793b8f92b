"""One attack: a command on mutated inputs, in a fork with bounded memory and time."""

import contextlib
import os
import random
import re
import resource
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import psutil

from tests.attacks.mutations import LINKS, mutate, with_link
from tests.attacks.services import POST, post
from tests.attacks.world import Attack

MEMORY = 2_500_000_000  # bytes
SECONDS = 60.0  # on the clock, or of CPU time where the machine is busy
STILL = 20.0  # further seconds with less than one second of CPU time are a hang
LINK_SHARE = 0.03
TRACE = "Traceback (most recent call last)"
CONTROLS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f\x9b]")
ROOM = ("MemoryError", "Unable to allocate", "bad_alloc", "cannot allocate")


@dataclass(frozen=True)
class Ended:
    """How a command ended: exit code, seconds, peak memory in bytes, and all that it printed."""

    code: int
    seconds: float
    peak: int
    output: str
    is_hang: bool = False


@dataclass(frozen=True)
class Outcome:
    """The outcome of an attack; `fault` is empty where all went well."""

    line: str
    seed: int
    file: str
    mutation: str
    ended: Ended
    fault: str


def attack(world: Path, folder: Path, chosen: Attack, seed: int) -> Outcome:
    """Copy `world` to `folder`, mutate an input of `chosen`, run it, and return the outcome."""
    rng = random.Random(seed)
    file = rng.choice(matching(world, rng.choice(chosen.inputs.split())))
    is_link = rng.random() < LINK_SHARE and chosen.words[0] != POST  # a body is not a file
    kind = rng.choice(LINKS) if is_link else ""
    return _tried(
        world,
        folder,
        chosen,
        seed,
        file,
        lambda path: with_link(path, kind) if kind else mutate(path, rng),
    )


def link_attack(
    world: Path, folder: Path, chosen: Attack, file: Path, kind: str, seed: int = 0
) -> Outcome:
    """Replace `file` of `world` by a link of `kind`, run, and return the outcome."""
    return _tried(world, folder, chosen, seed, file, lambda path: with_link(path, kind))


def unharmed_run(world: Path, folder: Path, chosen: Attack) -> Outcome:
    """Run the command of `chosen` on its right inputs, and return the outcome."""
    file = matching(world, chosen.inputs.split()[0])[0]
    outcome = _tried(world, folder, chosen, 0, file, lambda _path: "none")
    return replace(outcome, fault=outcome.fault or ("no success" if outcome.ended.code else ""))


def matching(world: Path, pattern: str) -> list[Path]:
    """Return the files of `world` that match a pattern of an attack's inputs."""
    return sorted(
        p.relative_to(world)
        for p in world.glob(pattern)
        if p.is_file() and not p.name.startswith(".")
    )


def _tried(
    world: Path, folder: Path, chosen: Attack, seed: int, file: Path, change: Callable[[Path], str]
) -> Outcome:
    shutil.copytree(world, folder, copy_function=os.link, symlinks=True)
    done = change(folder / file)
    ended = run(folder, chosen.words)
    fault = _fault(ended) or _half_written(folder, chosen)
    shutil.rmtree(folder, ignore_errors=True)
    return Outcome(chosen.line, seed, file.as_posix(), done, ended, fault)


def run(folder: Path, words: tuple[str, ...], memory: int = MEMORY) -> Ended:
    """Run the command line in a fork of this process, with `memory` bytes at most."""
    log = folder.with_name(f"{folder.name}.log")
    started = time.monotonic()
    child = os.fork()
    if child == 0:
        _child(folder, words, log, memory)
    peak, status, watch = 0, None, _Watch(child)
    while status is None:
        ended, found = os.waitpid(child, os.WNOHANG)
        if ended:
            status = found
            break
        peak = max(peak, _resident(child))
        if peak > memory or (time.monotonic() - started > SECONDS and watch.sees_hang()):
            os.killpg(child, signal.SIGKILL)
            status = os.waitpid(child, 0)[1]
            break
        time.sleep(0.01)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    output = log.read_text(errors="replace")
    log.unlink()
    seconds = round(time.monotonic() - started, 2)
    code = os.waitstatus_to_exitcode(status)
    return Ended(code, seconds, peak, output, watch.is_hang)


class _Watch:
    """The CPU time of a group of processes, measured once a second."""

    def __init__(self, group: int) -> None:
        self.group, self.is_hang = group, False
        self.used, self.looked, self.moved = 0.0, 0.0, time.monotonic()

    def sees_hang(self) -> bool:
        """Return whether the group has used all its seconds, or stands still."""
        now = time.monotonic()
        if now - self.looked > 1:
            used, self.looked = _cpu_seconds(self.group), now
            if used > self.used + 1:
                self.used, self.moved = used, now
            self.is_hang = used > SECONDS or now - self.moved > STILL
        return self.is_hang


def _cpu_seconds(group: int) -> float:
    total = 0.0
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error, ProcessLookupError):
            if os.getpgid(process.pid) == group:
                times = process.cpu_times()
                total += sum(times[:4])  # with the children that have ended
    return total


def _child(folder: Path, words: tuple[str, ...], log: Path, memory: int) -> None:
    code = 70
    try:
        os.setsid()
        with log.open("wb") as stream:
            os.dup2(stream.fileno(), 1)
            os.dup2(stream.fileno(), 2)
        os.chdir(folder)
        size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (size + memory, size + memory))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        sys.stdout, sys.stderr = (os.fdopen(n, "w", closefd=False) for n in (1, 2))
        from symgrasp_cli.app import app

        try:
            if words[0] == POST:
                sys.exit(post(Path(words[1])))
            app(list(words))
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
    except BaseException:
        traceback.print_exc()
    finally:
        with contextlib.suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _resident(process: int) -> int:
    with contextlib.suppress(OSError, IndexError, ValueError):
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * resource.getpagesize()
    return 0


def _fault(ended: Ended) -> str:
    room = any(word in ended.output for word in ROOM)
    faults = {
        "traceback": TRACE in ended.output,
        "memory": ended.peak > MEMORY or room,
        "hang": ended.is_hang,
        f"crash {ended.code}": ended.code not in (0, 1, 2),
        "escapes": CONTROLS.search(ended.output) is not None,
        "silent": ended.code != 0 and not ended.output.strip(),
    }
    return next((name for name, is_so in faults.items() if is_so), "")


def _half_written(folder: Path, chosen: Attack) -> str:
    """Return the fault of the outputs: temporary files left, or files that are not whole."""
    left = [p for p in folder.rglob(".*") if not p.name.startswith(".lock")]
    if left:
        return f"left {left[0].name}"
    output = folder / chosen.output
    files = output.rglob("*.h5") if output.is_dir() else [output] if output.suffix == ".h5" else []
    for path in files:
        if path.is_file() and not h5py.is_hdf5(path):
            return f"half-written {path.name}"
    return ""
