import math
from dataclasses import astuple

import numpy as np
import pytest

from gvp_lib.errors import InvalidParameterError
from gvp_lib.evaluation.statistics import Interval, paired_difference, summarize, wilson_interval

pytestmark = pytest.mark.check


@pytest.mark.parametrize(("successes", "n", "low", "high"), [(16, 20, 58, 92), (89, 100, 81, 94), (10, 10, 72, 100),
                                                             (0, 10, 0, 28), (0, 0, 0, 100)])  # fmt: skip
def test_a_rate_has_the_interval_of_errata_25_and_neither_one_nor_none_is_certain(successes, n, low, high) -> None:
    interval = wilson_interval(successes, n)
    assert (round(100 * interval.low), round(100 * interval.high)) == (low, high)


def test_the_numbers_are_those_of_numpy() -> None:
    values = np.random.default_rng(0).gamma(2, 3, 40)
    *numbers, interval = astuple(summarize(values))
    expected = [40, values.mean(), values.std(ddof=1), np.median(values), np.percentile(values, 95)]
    assert numbers == pytest.approx(expected)
    assert interval[0] < values.mean() < interval[1]


def test_seed_and_confidence_decide_the_interval() -> None:
    values = np.random.default_rng(0).exponential(size=15)
    assert summarize(values, seed=4) == summarize(values, seed=4)
    assert summarize(values, seed=4).interval != summarize(values, seed=5).interval
    wide, narrow = summarize(values, 0.99).interval, summarize(values, 0.5).interval
    assert wide.low < narrow.low < narrow.high < wide.high


@pytest.mark.parametrize(
    ("mean", "draw", "least", "most"),
    [
        (5.0, lambda rng: rng.normal(5, 2, 10), 0.85, 0.95),
        (3.0, lambda rng: rng.exponential(3, 60), 0.90, 0.98),
    ],
    ids=["few", "skewed"],
)
def test_the_bootstrap_covers_the_mean_nearly_as_often_as_it_says(mean, draw, least, most) -> None:
    # 0.95 nominal. 300 tries: the share itself is known to about 0.015.
    rng = np.random.default_rng(7)
    covered = np.mean([mean in summarize(draw(rng), seed=i).interval for i in range(300)])
    assert least < covered < most


@pytest.mark.filterwarnings("error")
def test_a_sample_too_small_or_too_alike_to_scatter_says_so() -> None:
    nan = math.nan
    np.testing.assert_equal(astuple(summarize([])), (0, nan, nan, nan, nan, (nan, nan)))
    np.testing.assert_equal(astuple(summarize([2.5])), (1, 2.5, nan, 2.5, 2.5, (nan, nan)))
    assert summarize([0.1] * 7).interval == Interval(0.1, 0.1)
    for values in ([1.0, 1.0 + 1e-15], [0.0] * 9 + [1.0], [1.0, 2.0]):  # where BCa is not defined
        assert np.isfinite(astuple(summarize(values).interval)).all()


def test_pairs_tell_apart_what_two_samples_do_not() -> None:
    rng = np.random.default_rng(1)
    difficulty = rng.normal(10, 5, 30)
    better, worse = difficulty + rng.normal(0, 0.3, 30), difficulty + 1 + rng.normal(0, 0.3, 30)
    assert summarize(worse).interval.low < summarize(better).interval.high  # they overlap
    difference = paired_difference(worse, better)
    assert difference.n == 30
    assert difference.interval.low > 0.5
    assert 1.0 in difference.interval


@pytest.mark.parametrize(
    ("misuse", "said"),
    [
        (lambda: wilson_interval(21, 20), "0 <= successes <= n; got successes=21, n=20"),
        (lambda: wilson_interval(0.5, 20), "successes is a whole number; got a float, 0.5"),  # type: ignore[arg-type]
        (lambda: summarize([1, math.nan, 2]), r"1 of 3 are not, the first at index 1: nan\. Leave out"),
        (lambda: summarize([[1, 2], [3, 4]]), r"got shape \(2, 2\)"),
        (lambda: summarize([1, 2], confidence=95), r"such as 0\.95; got 95"),
        (lambda: paired_difference([1, 2], [1, 2, 3]), "got 2 and 3 values"),
    ],
)
def test_misuse_is_answered_with_what_would_work(misuse, said) -> None:
    with pytest.raises(InvalidParameterError, match=said):
        misuse()
