"""The sample of a stream of grasps: even, and the same for every cut of the stream."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.rated_grasps import GraspSample, RatedGrasps, best_of_places
from pipelines.refinement.copies import point_affordance

seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=25, deadline=None)
MERGE = 0.001


def rated(contacts, quality):
    approach = np.tile([0.1, 0.2, 1.0], (len(contacts), 1))
    return RatedGrasps(GraspPoses.from_contacts(contacts, approach), np.asarray(quality, float))


def stream(rng, count=300, places=60):
    """Grasps at a few places, each several times, of random quality."""
    pairs = rng.uniform(-0.05, 0.05, (places, 2, 3))[rng.integers(places, size=count)]
    return rated(pairs, rng.integers(0, 10, count) / 10.0)


def sampled(grasps, limit, cuts=(), seed=0):
    sample = GraspSample(MERGE, limit, seed)
    for part in np.split(np.arange(len(grasps)), sorted(cuts)):
        sample.add(grasps[part])
    return sample


@few
@given(seeds, st.sampled_from([1000, 60, 20, 1]), st.lists(st.integers(0, 300), max_size=6))
def test_the_sample_does_not_depend_on_how_the_stream_is_cut(seed, limit, cuts):
    grasps = stream(np.random.default_rng(seed))
    whole, pieces = sampled(grasps, limit), sampled(grasps, limit, cuts)
    assert_array_equal(pieces.result().grasps.contacts, whole.result().grasps.contacts)
    assert_array_equal(pieces.result().quality, whole.result().quality)
    assert pieces.num_distinct == whole.num_distinct
    assert len(whole.result()) == min(limit, whole.num_distinct)


@few
@given(seeds)
def test_the_best_grasp_of_each_place_is_kept(seed):
    grasps = stream(np.random.default_rng(seed))
    kept = sampled(grasps, 1000, cuts=(100, 200)).result()
    places = np.unique(grasps.grasps.contacts.round(9), axis=0)
    best = [
        grasps.quality[np.isclose(grasps.grasps.contacts, place).all(axis=(1, 2))].max()
        for place in places
    ]
    assert len(kept) == len(places)
    assert_allclose(np.sort(kept.quality), np.sort(best))
    assert (np.diff(kept.quality) <= 0).all()


def test_an_even_sample_is_kept_of_grasps_beyond_the_limit():
    # Good grasps are a quarter of the places and nine tenths of the stream.
    rng = np.random.default_rng(0)
    good, poor = rng.uniform(-0.05, 0.05, (5000, 2, 3)), rng.uniform(-0.05, 0.05, (15000, 2, 3))
    pairs = np.concatenate([*[good] * 27, poor])
    quality = np.repeat([0.9, 0.1], [27 * 5000, 15000])
    sample = sampled(rated(pairs, quality), 4000, cuts=range(0, 150_000, 7000))
    kept = sample.result()
    assert len(kept) == 4000
    assert sample.num_distinct == 20000
    # Four standard deviations of an even draw.
    assert abs((kept.quality > 0.5).mean() - 0.25) < 4 * np.sqrt(0.25 * 0.75 / 4000)


def test_another_seed_draws_another_sample():
    grasps = stream(np.random.default_rng(0))
    first, second = (sampled(grasps, 20, seed=seed).result() for seed in (0, 1))
    assert len(first) == len(second) == 20
    assert not np.array_equal(first.grasps.contacts, second.grasps.contacts)


def test_an_empty_stream_is_an_empty_sample():
    assert len(GraspSample(MERGE, 10, 0).result()) == 0
    assert GraspSample(MERGE, 10, 0).num_distinct == 0


@few
@given(seeds, st.lists(st.integers(0, 300), max_size=6))
def test_the_best_of_places_does_not_depend_on_how_the_stream_is_cut(seed, cuts):
    grasps = stream(np.random.default_rng(seed))
    whole, pieces = best_of_places([grasps], 0.01), RatedGrasps.empty()
    for part in np.split(np.arange(len(grasps)), sorted(cuts)):
        pieces = best_of_places([pieces, grasps[part]], 0.01)
    assert_array_equal(pieces.grasps.contacts, whole.grasps.contacts)
    assert_array_equal(pieces.quality, whole.quality)


@few
@given(seeds)
def test_the_best_of_places_spreads_the_quality_of_all(seed):
    rng = np.random.default_rng(seed)
    size, radius = 0.002, 0.02
    grasps = rated(rng.uniform(-0.05, 0.05, (400, 2, 3)), rng.integers(1, 10, 400) / 10.0)
    best, points = best_of_places([grasps], size), rng.uniform(-0.05, 0.05, (60, 3))

    def spread(some, reach):
        return point_affordance(points, some.grasps.contacts, some.quality, reach)

    # Each contact has another one at least as good within `size`.
    assert (spread(best, radius) <= spread(grasps, radius)).all()
    assert (spread(best, radius) >= spread(grasps, radius - size)).all()
