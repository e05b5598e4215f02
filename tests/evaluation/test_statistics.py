import dataclasses
import math

import numpy as np
import pytest

from gvp_lib.errors import InvalidParameterError
from gvp_lib.evaluation.statistics import Interval, paired_difference, summarize, wilson_interval

pytestmark = pytest.mark.check

# wilson_interval


@pytest.mark.parametrize(("successes", "n", "low", "high"), [(16, 20, 58, 92), (89, 100, 81, 94)])
def test_the_theses_success_rates_have_the_intervals_of_errata_25(successes: int, n: int, low: int, high: int) -> None:
    interval = wilson_interval(successes, n)
    assert (round(100 * interval.low), round(100 * interval.high)) == (low, high)


def test_a_rate_of_one_or_none_is_not_certain() -> None:
    assert wilson_interval(10, 10).high == pytest.approx(1)
    assert wilson_interval(10, 10).low < 0.75
    assert wilson_interval(0, 10).low == pytest.approx(0)
    assert wilson_interval(0, 10).high > 0.25


def test_no_trial_says_nothing() -> None:
    assert wilson_interval(0, 0) == Interval(0.0, 1.0)


@pytest.mark.parametrize(("successes", "n"), [(21, 20), (-1, 20), (0.5, 20)])
def test_impossible_counts_are_refused(successes: float, n: int) -> None:
    with pytest.raises(InvalidParameterError, match="0 <= successes <= n; got"):
        wilson_interval(successes, n)


def test_wilson_covers_the_true_rate_about_as_often_as_it_says() -> None:
    successes = np.random.default_rng(3).binomial(20, 0.8, 2000)
    covered = np.mean([0.8 in wilson_interval(int(k), 20) for k in successes])
    assert 0.93 < covered < 0.98


# summarize


def test_the_numbers_are_those_of_numpy() -> None:
    values = np.random.default_rng(0).gamma(2, 3, 40)
    summary = summarize(values)
    assert summary.n == 40
    assert summary.mean == pytest.approx(values.mean())
    assert summary.sd == pytest.approx(values.std(ddof=1))
    assert summary.median == pytest.approx(np.median(values))
    assert summary.p95 == pytest.approx(np.percentile(values, 95))
    assert summary.interval.low < summary.mean < summary.interval.high


def test_the_seed_decides_the_interval() -> None:
    values = np.random.default_rng(0).exponential(size=15)
    assert summarize(values, seed=4) == summarize(values, seed=4)
    assert summarize(values, seed=4).interval != summarize(values, seed=5).interval


def test_more_confidence_is_a_wider_interval() -> None:
    values = np.random.default_rng(0).normal(size=30)
    wide, narrow = summarize(values, 0.99).interval, summarize(values, 0.5).interval
    assert wide.low < narrow.low < narrow.high < wide.high


@pytest.mark.parametrize(("n", "least", "most"), [(10, 0.85, 0.95), (60, 0.92, 0.97)])
def test_the_bootstrap_covers_the_mean_nearly_as_often_as_it_says(n: int, least: float, most: float) -> None:
    # 0.95 nominal. 300 tries: the share itself is known to about 0.015.
    rng = np.random.default_rng(7)
    covered = np.mean([5.0 in summarize(rng.normal(5, 2, n), seed=i).interval for i in range(300)])
    assert least < covered < most


def test_the_bootstrap_also_covers_the_mean_of_skewed_values() -> None:
    rng = np.random.default_rng(8)
    covered = np.mean([3.0 in summarize(rng.exponential(3, 60), seed=i).interval for i in range(300)])
    assert 0.90 < covered < 0.98


def test_nothing_has_no_numbers() -> None:
    summary = summarize([])
    assert summary.n == 0
    assert all(math.isnan(x) for x in (summary.mean, summary.sd, summary.median, summary.p95))
    assert math.isnan(summary.interval.low)


def test_one_value_has_a_mean_and_no_spread() -> None:
    summary = summarize([2.5])
    assert (summary.n, summary.mean, summary.median) == (1, 2.5, 2.5)
    assert math.isnan(summary.sd)
    assert math.isnan(summary.interval.high)


def test_a_constant_sample_has_an_interval_of_no_width() -> None:
    assert summarize([0.1] * 7).interval == Interval(0.1, 0.1)


@pytest.mark.filterwarnings("error")
def test_two_nearly_equal_values_have_a_finite_interval() -> None:
    for values in ([1.0, 1.0 + 1e-15], [0.0] * 9 + [1.0], [1.0, 2.0]):
        interval = summarize(values).interval
        assert math.isfinite(interval.low)
        assert math.isfinite(interval.high)


def test_what_is_not_a_number_is_refused_with_its_place() -> None:
    with pytest.raises(InvalidParameterError, match=r"1 of 3 are not, the first at index 1: nan\. Leave out"):
        summarize([1.0, float("nan"), 2.0])


def test_a_table_is_no_sample() -> None:
    with pytest.raises(InvalidParameterError, match=r"got shape \(2, 2\)"):
        summarize([[1.0, 2.0], [3.0, 4.0]])


def test_a_confidence_in_percent_is_refused() -> None:
    with pytest.raises(InvalidParameterError, match=r"such as 0\.95; got 95"):
        summarize([1.0, 2.0], confidence=95)


def test_a_summary_cannot_be_changed() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        summarize([1.0]).mean = 2.0  # type: ignore[misc]


# paired_difference


def test_pairs_tell_apart_what_two_samples_do_not() -> None:
    rng = np.random.default_rng(1)
    difficulty = rng.normal(10, 5, 30)
    better, worse = difficulty + rng.normal(0, 0.3, 30), difficulty + 1 + rng.normal(0, 0.3, 30)
    assert summarize(worse).interval.low < summarize(better).interval.high  # they overlap
    difference = paired_difference(worse, better)
    assert difference.n == 30
    assert difference.interval.low > 0.5
    assert 1.0 in difference.interval


def test_samples_of_unequal_length_are_no_pairs() -> None:
    with pytest.raises(InvalidParameterError, match="got 2 and 3 values"):
        paired_difference([1, 2], [1, 2, 3])
