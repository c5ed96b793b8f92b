"""Wilson's interval against published values and known laws."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipelines.metrics.success_rate import success_rate


def interval(trials, held):
    rate = success_rate(trials, held)
    return rate["low"], rate["high"]


@pytest.mark.parametrize(
    ("held", "trials", "low", "high"),
    [  # Newcombe, Statistics in Medicine 17 (1998), table I, method 3
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0000, 0.1611),
        (1, 29, 0.0061, 0.1718),
        (10, 10, 0.7225, 1.0000),
    ],
)
def test_the_interval_equals_published_values_of_wilsons(held, trials, low, high):
    assert interval(trials, held) == pytest.approx((low, high), abs=5e-5)


counts = st.integers(1, 500).flatmap(lambda n: st.tuples(st.just(n), st.integers(0, n)))


@given(counts)
def test_the_interval_contains_the_rate_and_stays_within_0_to_1(count):
    low, high = interval(*count)
    assert 0.0 <= low <= success_rate(*count)["rate"] <= high <= 1.0
    assert low < high


@given(counts)
def test_failures_have_the_mirrored_interval(count):
    trials, held = count
    low, high = interval(trials, held)
    assert interval(trials, trials - held) == pytest.approx((1 - high, 1 - low))


@given(counts)
def test_more_trials_of_the_same_rate_narrow_the_interval(count):
    trials, held = count
    low, high = interval(trials, held)
    lower, higher = interval(4 * trials, 4 * held)
    assert higher - lower < high - low


def test_no_trials_give_no_rate():
    assert success_rate(0, 0)["rate"] is None
    assert interval(0, 0) == (None, None)
