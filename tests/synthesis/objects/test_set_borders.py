"""Training, `dev` and `sealed` share no seed, object, family or generator."""

import ast
import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from pipelines.synthesis.objects.families import catalogue
from pipelines.synthesis.objects.families.catalogue import FAMILIES
from pipelines.synthesis.objects.pools import (
    FAMILIES_OF_POOL,
    POOLS_OF_FAMILIES,
    UNSEEN_POOLS,
    make_object,
)

ROOT = Path(__file__).resolve().parents[3]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
FAMILY_FOLDER = ROOT / "pipelines" / "synthesis" / "objects" / "families"
SET_ASIDE = {"dev": range(700, 800), "sealed": range(900, 1000)}
MORE_OF_DEV = {702}  # further scenes to decide on: docs/experiments/tables-on-dev.md
MORE_OF_SEALED = {901}  # docs/experiments/sealed.md
TRAINED = {family for pool in ("seen", "wide") for family in FAMILIES_OF_POOL[pool]}


def recipe(name: str) -> str:
    found = re.search(rf"^SET_{name} := ((?:.*\\\n)*.*)$", MAKEFILE, re.MULTILINE)
    assert found is not None
    return found[1].replace("\\\n", " ")


def option(name: str, of: str) -> str:
    found = re.search(rf"--{name} (\S+)", recipe(of))
    assert found is not None
    return found[1]


def pools(of: str) -> list[str]:
    places = {"train": 0, "seen": 0, "similar": 1, "novel": 2}
    chosen = POOLS_OF_FAMILIES[option("families", of)]
    return [chosen[places[split]] for split in option("split", of).split(",")]


def generator(family: str) -> object:
    return FAMILIES[family]


@pytest.mark.parametrize("name", SET_ASIDE)
def test_seeds_of_a_set_are_in_its_range_and_seeds_of_other_recipes_are_outside(name):
    assert int(option("seed", name)) in SET_ASIDE[name]
    texts = [path.read_text(encoding="utf-8") for path in (ROOT / "docs").rglob("*.md")]
    texts += [path.read_text(encoding="utf-8") for path in (ROOT / "tools").rglob("*.sh")]
    others = MAKEFILE.replace(f"--seed {option('seed', 'dev')}", "")
    others = others.replace(f"--seed {option('seed', 'sealed')}", "")
    seeds = [
        int(number) for text in (*texts, others) for number in re.findall(r"--seed (\d+)", text)
    ]
    assert len(seeds) > 3
    assert not [
        seed
        for seed in seeds
        if seed in SET_ASIDE[name] and seed not in MORE_OF_DEV | MORE_OF_SEALED
    ]


def test_no_pool_of_dev_or_sealed_is_trained_on():
    for name in SET_ASIDE:
        assert set(pools(name)) <= set(UNSEEN_POOLS)
    trained = {chosen[0] for chosen in POOLS_OF_FAMILIES.values()}
    assert trained.isdisjoint(UNSEEN_POOLS)


def test_novel_families_are_in_no_training_and_sealed_families_in_no_other_set():
    novel, sealed = set(FAMILIES_OF_POOL["novel"]), set(FAMILIES_OF_POOL["sealed"])
    assert pools("dev")[1] == "novel"
    assert pools("sealed")[1] == "sealed"
    assert novel.isdisjoint(TRAINED)
    assert sealed.isdisjoint(TRAINED | novel)


def test_no_two_families_share_a_generator():
    assert len({generator(family) for family in FAMILIES}) == len(FAMILIES)
    assert {FAMILIES[family].__module__ for family in FAMILIES_OF_POOL["sealed"]} == {
        "pipelines.synthesis.objects.families.sealed"
    }


def test_code_of_sealed_and_of_other_families_is_separate():
    def imported(path: Path) -> set[str]:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        return {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}

    package = "pipelines.synthesis.objects.families"
    own = imported(FAMILY_FOLDER / "sealed.py")
    assert not any(name.startswith(package) for name in own)
    assert "pipelines.synthesis.objects.revolved" not in own  # the lathe of trained families
    for path in FAMILY_FOLDER.glob("*.py"):
        if path.stem not in ("sealed", "catalogue"):
            assert f"{package}.sealed" not in imported(path)
    assert catalogue.SEALED.keys() == set(FAMILIES_OF_POOL["sealed"])


def test_no_object_is_in_two_pools_or_made_from_two_seeds():
    """Objects of the first family of all pools differ by more than rounding."""
    made = {
        (pool, seed, index): make_object(pool, index, seed).mesh.volume
        for pool in ("seen", "similar", "wide", "wide_similar")
        for seed in (0, 700, 900)
        for index in (0, len(FAMILIES_OF_POOL[pool]))
    }
    volumes = np.array(list(made.values()))
    gaps = [abs(a / b - 1.0) for a, b in combinations(volumes, 2)]
    assert min(gaps) > 1e-6


def test_sealed_shows_at_least_a_thousand_objects():
    count, scenes = int(option("objects", "sealed")), int(option("scenes-per-split", "sealed"))
    rng = np.random.default_rng(0)
    shown = set()
    for _ in range(scenes):
        shown |= set(rng.choice(count, int(rng.integers(4, 10)), replace=False).tolist())
    assert 2 * len(shown) >= 1000


def test_make_sealed_refuses_a_second_evaluation():
    (rule,) = re.findall(r"^sealed: .*\n((?:\t.*\n)+)", MAKEFILE, re.MULTILINE)
    first = rule.splitlines()[0]
    assert "build/sealed/report.json" in first
    assert "exit 1" in first
