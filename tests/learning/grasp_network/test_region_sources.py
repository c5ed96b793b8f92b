"""The regions of a batch: packed, rendered, or both."""

from dataclasses import replace

import numpy as np
import pytest

from pipelines.configs import EndlessConfig
from pipelines.dataset.training.packed_regions import PackedReader
from pipelines.learning.grasp_network.region_sources import (
    PACKED,
    RegionSet,
    TrainingRegions,
    packed_items,
    rendered_items,
)
from tests.learning.packed_toys import CONFIG, write_packed

ENDLESS = EndlessConfig(scenes_together=3, regions_per_scene=4, epoch_regions=30)


class Rendered:
    """A stand-in for an `EndlessPool`, whose points encode the scene and slot of a region."""

    def __init__(self, region):
        self.some = region

    def region(self, scene, slot):
        return replace(self.some, points=self.some.points + np.float32(scene + 0.1 * slot))


@pytest.fixture(scope="module")
def packed(tmp_path_factory):
    reader = PackedReader(write_packed(tmp_path_factory.mktemp("packed"), 2))
    return RegionSet(reader, np.arange(len(reader)))


def rng(seed=0):
    return np.random.default_rng(seed)


def test_no_region_is_rendered_twice_and_no_scene_in_two_epochs():
    epochs = [rendered_items(number, 30, ENDLESS, rng(number)) for number in range(4)]
    scenes = [set(items[:, 0].tolist()) for items in epochs]
    for number, items in enumerate(epochs):
        assert items.shape == (30, 2)
        assert len(np.unique(items, axis=0)) == 30
        assert all(scenes[number].isdisjoint(other) for other in scenes[:number])


def test_groups_of_scenes_come_in_order_and_are_shuffled_inside():
    items = rendered_items(2, 36, ENDLESS, rng())
    groups = items[:, 0] // ENDLESS.scenes_together
    assert groups.tolist() == sorted(groups.tolist())
    assert items[:12].tolist() != sorted(items[:12].tolist())


def test_a_batch_has_its_share_of_packed_and_rendered_regions(packed):
    config = replace(CONFIG, batch_size=6, endless=replace(ENDLESS, share=0.33))
    batches = TrainingRegions(packed, Rendered(None), config).epoch(0, rng())
    assert [int((batch[:, 0] != PACKED).sum()) for batch in batches] == [2] * 6
    shown = np.concatenate(batches)
    own = shown[shown[:, 0] == PACKED, 1]
    assert len(set(own.tolist())) == len(own) == 24
    places = [np.flatnonzero(batch[:, 0] != PACKED).tolist() for batch in batches]
    assert len({tuple(each) for each in places}) > 1  # mixed, so that micro-batches are similar


def test_without_packed_regions_an_epoch_has_the_configured_length():
    config = replace(CONFIG, batch_size=6, endless=replace(ENDLESS, share=1.0))
    batches = TrainingRegions(None, Rendered(None), config).epoch(1, rng())
    assert [batch.shape for batch in batches] == [(6, 2)] * 5
    assert all((batch[:, 0] != PACKED).all() for batch in batches)


def test_each_item_is_loaded_from_its_own_source(packed):
    source = TrainingRegions(packed, Rendered(packed.reader[0]), CONFIG)
    items = np.concatenate([packed_items(np.array([5])), [[7, 2]]])
    batch = source.load(items, [rng(1), rng(1)])
    alone = source.load(items[:1], [rng(1)])
    np.testing.assert_array_equal(batch.points[0], alone.points[0])
    assert not batch.center[1, 0].allclose(batch.center[0, 0])
    with pytest.raises(LookupError):
        TrainingRegions(None, None, CONFIG).load(items, [rng(1), rng(1)])
