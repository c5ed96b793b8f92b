"""Wilson's interval against published values and its own laws."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipelines.metrics.success_rate import SuccessRate


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
def test_the_interval_is_wilsons(held, trials, low, high):
    assert SuccessRate(trials, held).interval == pytest.approx((low, high), abs=5e-5)


counts = st.integers(1, 500).flatmap(lambda n: st.tuples(st.just(n), st.integers(0, n)))


@given(counts)
def test_the_interval_holds_the_rate_and_stays_within_0_to_1(count):
    rate = SuccessRate(*count)
    low, high = rate.interval
    assert 0.0 <= low <= rate.rate <= high <= 1.0
    assert low < high


@given(counts)
def test_failures_have_the_mirrored_interval(count):
    trials, held = count
    low, high = SuccessRate(trials, held).interval
    assert SuccessRate(trials, trials - held).interval == pytest.approx((1 - high, 1 - low))


@given(counts)
def test_more_trials_of_the_same_rate_narrow_the_interval(count):
    trials, held = count
    low, high = SuccessRate(trials, held).interval
    lower, higher = SuccessRate(4 * trials, 4 * held).interval
    assert higher - lower < high - low


def test_no_trials_make_no_rate():
    assert SuccessRate(0, 0).rate is None
    assert SuccessRate(0, 0).interval == (None, None)
