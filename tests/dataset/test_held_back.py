"""Refusal to train on roots that are kept for evaluation."""

import pytest

from pipelines.dataset import object_list
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.held_back import HELD_BACK_POOLS, TRAINING_POOLS, refuse_held_back
from pipelines.dataset.object_list import ObjectRecord
from pipelines.errors import SymgraspError
from pipelines.storage.provenance import make_stamp
from pipelines.synthesis.objects.pools import FAMILIES_OF_POOL, UNSEEN_POOLS


def root_of(folder, *pools):
    records = [ObjectRecord(i, f"o{i}", "can", pool) for i, pool in enumerate(pools)]
    object_list.write(folder / "objects.json", records, make_stamp("test", {}))
    return GraspNetRoot(folder)


@pytest.mark.parametrize("pools", [("wide_similar", "novel"), ("wide_similar", "sealed")])
def test_a_root_made_by_make_dev_or_sealed_is_refused_in_one_sentence(tmp_path, pools):
    with pytest.raises(SymgraspError, match="kept for evaluation") as refusal:
        refuse_held_back(root_of(tmp_path, *pools))
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("pools", [("wide", "wide_similar"), ("seen",), ("similar", "novel"), ()])
def test_other_roots_are_not_refused(tmp_path, pools):
    refuse_held_back(root_of(tmp_path, *pools))
    refuse_held_back(GraspNetRoot(tmp_path / "without"))


def test_the_names_of_pools_are_those_of_synthesize():
    assert set(UNSEEN_POOLS) >= HELD_BACK_POOLS
    assert set(FAMILIES_OF_POOL) - set(UNSEEN_POOLS) == TRAINING_POOLS
