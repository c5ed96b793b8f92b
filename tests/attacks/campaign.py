"""A folder of right inputs (the world), made once, and attacks on it in turn."""

import importlib
import os
import random
import sys
from collections.abc import Iterator
from itertools import product
from pathlib import Path

from tests.attacks import world
from tests.attacks.mutations import LINKS
from tests.attacks.services import POST
from tests.attacks.trial import (
    Outcome,
    attack,
    link_attack,
    matching,
    run,
    unharmed_run,
)


def made_world(folder: Path, *, small: bool = False) -> Path:
    """Return the folder of right inputs in `folder`, after making it if it is missing."""
    import_stages()
    made = folder / "world"
    if not made.exists():
        building = folder / "building"
        building.mkdir(parents=True)
        _in_fork(lambda: world.build(building, _run_well, small=small))
        building.rename(made)
    return made


def attacked(
    made: Path,
    folder: Path,
    count: int,
    first: int = 0,
    *,
    small: bool = False,
    named: str = "",
) -> Iterator[Outcome]:
    """Yield the outcomes of `count` attacks; the same seeds give the same attacks.

    `named`: first words of the command lines to attack; empty for all.
    """
    attacks = [
        each for each in world.ATTACKS if (each.small or not small) and each.line.startswith(named)
    ]
    shares = [each.share for each in attacks]
    for seed in range(first, first + count):
        (chosen,) = random.Random(seed).choices(attacks, shares)
        yield attack(made, folder / f"try{seed}", chosen, seed)


def unharmed(made: Path, folder: Path, *, small: bool = False) -> Iterator[Outcome]:
    """Yield the outcome of each command on its right inputs, with a fault if it fails."""
    for number, chosen in enumerate(world.ATTACKS):
        if chosen.small or not small:
            yield unharmed_run(made, folder / f"well{number}", chosen)


def swept_by_links(made: Path, folder: Path) -> Iterator[Outcome]:
    """Yield the outcome of each command with each of `LINKS` in the place of each input."""
    for chosen in world.ATTACKS:
        if chosen.words[0] != POST:  # its input is the body of a request, not a file
            files = {p for each in chosen.inputs.split() for p in matching(made, each)}
            for number, (file, kind) in enumerate(product(sorted(files), LINKS)):
                yield link_attack(made, folder / f"link{number}", chosen, file, kind)


def import_stages() -> None:
    """Import the modules of all commands once for all forks; runs no loop, starts no thread."""
    import torch

    from symgrasp_cli.app import COMMANDS

    torch.set_num_threads(1)
    os.environ["SYMGRASP_WORKERS"] = "1"
    importlib.import_module("pydantic")  # by typer, at a command's first option
    for command in COMMANDS:
        name = command.__module__.replace("symgrasp_cli", "pipelines")
        if importlib.util.find_spec(name) is not None:
            importlib.import_module(name)


def _in_fork(work: object) -> None:
    child = os.fork()
    if child == 0:
        work()
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0


def _run_well(folder: Path, line: str) -> None:
    ended = run(folder, tuple(line.split()), 8_000_000_000)
    if ended.code:
        sys.exit(f"{line}: {ended.output}")
