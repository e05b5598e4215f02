"""A claim of the thesis: where it is made, what was measured, and the rule that decides whether it holds.

A rule belongs to its claim and knows no result; the measurement reads a stored result and knows no verdict. So when a
result is computed again, the numbers and, if need be, the verdict change by themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from enum import Enum
from functools import lru_cache
from typing import Any

import numpy as np
from scipy import stats

from gvp_lib.errors import InvalidParameterError
from gvp_lib.evaluation.statistics import summarize, wilson_interval

Stored = Mapping[str, Any]  # contents of stored results, by name

NAMES = {
    "cuboid_1x1": "1x1 brick",
    "cuboid_1x2": "1x2 brick",
    "cuboid_1x3": "1x3 brick",
    "cuboid_1x4": "1x4 brick",
    "cylinder": "can",
    "alligator": "alligator",
    "tomato_soup_box": "soup carton",
}


class Verdict(Enum):
    """Verdict of a rule on a measurement."""

    HOLDS = "holds"
    BETTER = "better here"
    FAILS = "does not hold"
    OPEN = "undecided"
    CHAPTER = "see chapter"


@dataclass(frozen=True, slots=True)
class Measured:
    """Number with its interval and unit."""

    value: float  # a mean, or a rate in per cent
    n: int | None = None  # how many episodes, grasps or trainings; None where the number is no average
    low: float | None = None  # ends of the 95 % interval; None where there is none
    high: float | None = None
    unit: str = "deg"  # as it is printed
    sd: float | None = None  # standard deviation, of a mean

    def __str__(self) -> str:
        digits = 2 if self.unit == "deg" and abs(self.value) < 1 else 1
        parts = [f"{self.value:.{digits}f}"]
        if self.sd is not None:
            parts.append(f"± {self.sd:.{digits}f}")
        if self.low is not None and self.high is not None:
            parts.append(f"[{self.low:.{digits}f}, {self.high:.{digits}f}]")
        return " ".join([*parts, self.unit]).strip()

    @property
    def ends(self) -> tuple[float, float]:
        """Ends of the interval; the value itself if there is no interval."""
        return self.value if self.low is None else self.low, self.value if self.high is None else self.high

    @classmethod
    def of_mean(cls, summary: Mapping[str, Any], unit: str = "deg", scale: float = 1.0) -> Measured:
        """Make one from a stored :class:`gvp_lib.evaluation.statistics.Summary`."""
        ends = (summary["interval"]["low"], summary["interval"]["high"], summary["sd"])
        low, high, sd = (None if end is None else scale * end for end in ends)
        return cls(scale * summary["mean"], summary["n"], low, high, unit, sd)

    @classmethod
    def of_values(cls, values: Iterable[float], unit: str = "deg") -> Measured:
        """Mean of some values, with a bootstrap interval."""
        return cls.of_mean(asdict(_summarized(tuple(values))), unit)

    @classmethod
    def of_printed(cls, mean: float, sd: float, n: int) -> Measured:
        """Printed mean and standard deviation of n trials, deg, with the interval that they imply (Student's t)."""
        half = float(stats.t.ppf(0.975, n - 1)) * sd / np.sqrt(n)
        return cls(mean, n, mean - half, mean + half, "deg", sd)

    @classmethod
    def counted(cls, successes: int, n: int) -> Measured:
        """Rate with its Wilson interval, in percent."""
        interval = wilson_interval(successes, n)
        return cls(100 * successes / n if n else 0.0, n, 100 * interval.low, 100 * interval.high, "%")


_summarized = lru_cache(maxsize=64)(summarize)  # several claims are about the same episodes; a bootstrap takes a while


@dataclass(frozen=True, slots=True)
class Found:
    """What the stored results say about a claim."""

    ours: Measured  # the thesis's own planner, in our simulation
    why: str  # a sentence or two, with whatever numbers make the result plain
    beside: Measured | None = None  # what it is held against: the thesis's number, or another of ours
    better: Measured | None = None  # the same of our planner


@dataclass(frozen=True, slots=True)
class Rule:
    """Condition under which a claim holds: in words, and as a function of what was found."""

    text: str
    judge: Callable[[Measured, Measured | None], Verdict]

    @classmethod
    def compared(cls, text: str, lower: Verdict, overlap: Verdict, higher: Verdict, limit: float | None = None) -> Rule:
        """Make a rule with a verdict each for our interval being below the other, overlapping it, and being above it.

        A limit may take the place of the other interval; an interval that ends at the limit is below it.
        """

        def judge(ours: Measured, beside: Measured | None) -> Verdict:
            other = beside if limit is None else Measured(float(np.nextafter(limit, np.inf)))
            if other is None:
                raise InvalidParameterError("a rule that compares needs what the measurement is held against; got none")
            (low, high), (other_low, other_high) = ours.ends, other.ends
            return lower if high < other_low else higher if low > other_high else overlap

        return cls(text, judge)

    @classmethod
    def below(cls, text: str, limit: float | None = None) -> Rule:
        """Rule for what should be smaller than something else."""
        return cls.compared(text, Verdict.HOLDS, Verdict.OPEN, Verdict.FAILS, limit)

    @classmethod
    def above(cls, text: str, limit: float | None = None) -> Rule:
        """Rule for what should be larger than something else."""
        return cls.compared(text, Verdict.FAILS, Verdict.OPEN, Verdict.HOLDS, limit)

    @classmethod
    def at_most(cls, limit: float, unit: str) -> Rule:
        """Rule for what should be small."""
        return cls.below(f"the whole interval lies at or below {limit:g} {unit}", limit)

    @classmethod
    def more_than(cls, limit: float, unit: str) -> Rule:
        """Rule for what should be large."""
        return cls.above(f"the whole interval lies above {limit:g} {unit}", limit)

    @classmethod
    def agrees(cls, text: str = "the two intervals overlap") -> Rule:
        """Rule for what should be the same."""
        return cls.compared(text, Verdict.FAILS, Verdict.HOLDS, Verdict.FAILS)

    @classmethod
    def no_worse(cls, *, larger_is_better: bool) -> Rule:
        """Rule for a table cell: as good as in the thesis, or better."""
        lower, higher = (Verdict.FAILS, Verdict.BETTER) if larger_is_better else (Verdict.BETTER, Verdict.FAILS)
        text = "ours and the thesis's intervals overlap, or ours is the better one"
        return cls.compared(text, lower, Verdict.HOLDS, higher)


@dataclass(frozen=True, slots=True)
class Claim:
    """Sentence or table cell of the thesis, judged by a rule on stored results or shown in a chapter, and why."""

    section: str  # number of the thesis's section
    place: str  # where in it: a table, a figure, "text"
    says: str  # what is claimed, in our words
    printed: str  # its value as printed
    chapter: str  # stem of the notebook that looks into it
    results: tuple[str, ...] = ()  # names of the stored results that it is held against
    rule: Rule | None = None
    measure: Callable[[Stored], Found] | None = None  # reads the results' contents
    why: str = ""  # what the chapter shows, of a claim without results
