"""Means and rates with the intervals that say how much they are worth. Thesis 3.1; errata 25.

Ten trials of a case are few: 16 of 20 grasps that held say only that between 58 and 92 % would. Every number that the
book reports comes with its n and its interval.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError

__all__ = ["Interval", "Summary", "paired_difference", "summarize", "wilson_interval"]

_RESAMPLES = 4999
_AT_ONCE = 1_000_000  # numbers in memory, of the resamples' n each
_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class Interval:
    """Confidence interval, ends included, in the unit of what it bounds; NaN to NaN where the data give none.

    Attributes
    ----------
    low, high
        Its ends.
    """

    low: float
    high: float

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high

    def __repr__(self) -> str:
        return f"[{self.low:.3g}, {self.high:.3g}]"


@dataclass(frozen=True, slots=True)
class Summary:
    """Sample in a few numbers, all in its own unit.

    Attributes
    ----------
    n
        Number of values. Where it is 0, the rest is NaN.
    mean
        Mean of the sample.
    sd
        Standard deviation of the population the values came from (divisor n - 1); NaN for n < 2.
    median, p95
        50th and 95th percentile of the sample, linear between two values.
    interval
        Bootstrap confidence interval of the mean; see :func:`summarize`.
    """

    n: int
    mean: float
    sd: float
    median: float
    p95: float
    interval: Interval

    def __repr__(self) -> str:
        return f"Summary(n {self.n}, mean {self.mean:.3g} {self.interval}, sd {self.sd:.3g}, median {self.median:.3g})"


@checked
def summarize(values: ArrayLike, confidence: float = 0.95, seed: int = 0) -> Summary:
    """Summarize a sample: mean, spread, percentiles, and a bootstrap interval of the mean.

    The interval is bias-corrected and accelerated (BCa; Efron 1987). It assumes nothing about the shape of the
    distribution, but it is too narrow for few values: with ten normal ones, a nominal 95 % covers the mean in about
    88 % of all samples.

    Parameters
    ----------
    values
        Sample, shape (n,), finite. Leave out the episodes that have no value, and report how many they are.
    confidence
        Nominal coverage of the interval, in (0, 1).
    seed
        Seed of the resampling; the same values and seed give the same interval.

    Notes
    -----
    Where BCa is not defined, the interval is, in this order: NaN to NaN for fewer than two values, which do not say
    how they scatter; the mean to the mean for a constant sample; the plain percentile bootstrap elsewhere.

    Examples
    --------
    >>> summary = summarize([1.0, 2.0, 3.0, 6.0])
    >>> summary.n, summary.mean, summary.median
    (4, 3.0, 2.5)
    >>> 3.0 in summary.interval
    True
    """
    sample = _sample(values, "values")
    _check_confidence(confidence)
    if sample.size == 0:
        return Summary(0, _NAN, _NAN, _NAN, _NAN, Interval(_NAN, _NAN))
    sd = float(sample.std(ddof=1)) if sample.size > 1 else _NAN
    median, p95 = np.percentile(sample, (50, 95)).tolist()
    return Summary(sample.size, float(sample.mean()), sd, median, p95, _mean_interval(sample, confidence, seed))


@checked
def paired_difference(a: ArrayLike, b: ArrayLike, confidence: float = 0.95, seed: int = 0) -> Summary:
    """Summarize ``a - b`` for two methods tried on the same episodes.

    The episodes' own difficulty cancels, so that far fewer of them tell two methods apart.

    Parameters
    ----------
    a, b
        One value per episode, shape (n,), in the same order; leave out episodes in which either has none.
    confidence, seed
        As in :func:`summarize`.

    Examples
    --------
    >>> paired_difference([1.0, 2.0, 4.0], [2.0, 3.0, 5.0]).mean
    -1.0
    """
    first, second = _sample(a, "a"), _sample(b, "b")
    if first.shape != second.shape:
        raise InvalidParameterError(
            f"paired samples have one value each for the same episodes; got {first.size} and {second.size} values. "
            "Keep the episodes that both have"
        )
    return summarize(first - second, confidence, seed)


@checked
def wilson_interval(successes: int, n: int, confidence: float = 0.95) -> Interval:
    """Wilson's score interval of a success rate, within [0, 1].

    Unlike the mean and its standard error, it holds for few trials and near 0 and 1. For ``n = 0`` it is all of [0, 1].

    Parameters
    ----------
    successes, n
        Successes, and trials.
    confidence
        Nominal coverage, in (0, 1).

    Examples
    --------
    >>> interval = wilson_interval(16, 20)
    >>> f"{interval.low:.0%} to {interval.high:.0%}"
    '58% to 92%'
    """
    _check_confidence(confidence)
    if not 0 <= successes <= n:
        raise InvalidParameterError(
            f"successes and n are whole numbers, 0 <= successes <= n; got successes={successes}, n={n}"
        )
    if n == 0:
        return Interval(0.0, 1.0)
    low, high = stats.binomtest(successes, n).proportion_ci(confidence, method="wilson")
    return Interval(float(low), float(high))


def _mean_interval(sample: NDArray[np.float64], confidence: float, seed: int) -> Interval:
    low = high = float(sample[0]) if sample.size > 1 else _NAN
    if sample.size < 2 or np.ptp(sample) == 0:
        return Interval(low, high)
    for method in ("BCa", "percentile"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", stats.DegenerateDataWarning)  # it is answered by the next method
            low, high = stats.bootstrap(
                (sample,),
                np.mean,
                confidence_level=confidence,
                n_resamples=_RESAMPLES,
                batch=max(1, _AT_ONCE // sample.size),
                method=method,
                rng=np.random.default_rng(seed),
            ).confidence_interval
        if np.isfinite((low, high)).all():
            break
    return Interval(float(low), float(high))


def _sample(values: ArrayLike, name: str) -> NDArray[np.float64]:
    sample = np.asarray(values, float)
    if sample.ndim != 1:
        raise InvalidParameterError(f"{name} has shape (n,), one number per episode; got shape {sample.shape}")
    bad = np.flatnonzero(~np.isfinite(sample))
    if bad.size:
        raise InvalidParameterError(
            f"{name} must be finite; {bad.size} of {sample.size} are not, the first at index {bad[0]}: "
            f"{sample[bad[0]]}. Leave out the episodes that have no value, and report how many they are"
        )
    return sample


def _check_confidence(confidence: float) -> None:
    if not 0 < confidence < 1:
        raise InvalidParameterError(f"a confidence is between 0 and 1, such as 0.95; got {confidence}")
