"""A claim of the thesis: where it stands, what was measured of it, and the rule that says whether it holds.

A rule stands beside its claim and knows no result; the measurement reads a stored result and knows no verdict. So a
result that is computed anew changes the numbers and, where it must, the verdict, and nobody has to remember to.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

from gvp_lib.errors import InvalidParameterError

__all__ = [
    "Claim",
    "Found",
    "Measured",
    "Rule",
    "Verdict",
    "agrees",
    "at_most",
    "below",
    "above",
    "more_than",
    "no_worse",
    "of_mean",
    "of_rate",
]

Stored = Mapping[str, Any]  # contents of stored results, by name


class Verdict(Enum):
    """What a rule makes of a measurement."""

    HOLDS = "holds"
    BETTER = "better here"
    FAILS = "does not hold"
    OPEN = "undecided"
    CHAPTER = "see chapter"


@dataclass(frozen=True, slots=True)
class Measured:
    """A number with its interval, in its unit.

    Attributes
    ----------
    value
        A mean, or a rate in per cent.
    n
        How many episodes, grasps or trainings; None where the number is no average.
    low, high
        Ends of the 95 % interval; None where there is none.
    unit
        As it is printed: ``"deg"``, ``"%"``.
    sd
        Standard deviation, of a mean.
    """

    value: float
    n: int | None = None
    low: float | None = None
    high: float | None = None
    unit: str = "deg"
    sd: float | None = None

    def __str__(self) -> str:
        digits = 2 if self.unit == "deg" and abs(self.value) < 1 else 1
        parts = [f"{self.value:.{digits}f}"]
        if self.sd is not None:
            parts.append(f"± {self.sd:.{digits}f}")
        if self.low is not None and self.high is not None:
            parts.append(f"[{self.low:.{digits}f}, {self.high:.{digits}f}]")
        return " ".join([*parts, self.unit]).strip()


@dataclass(frozen=True, slots=True)
class Found:
    """What the stored results say of a claim.

    Attributes
    ----------
    ours
        The thesis's own planner, in our simulation.
    why
        A sentence or two, with whatever numbers make the result plain.
    beside
        What ``ours`` is held against: the thesis's number, or another of ours.
    better
        The same of our planner.
    """

    ours: Measured
    why: str
    beside: Measured | None = None
    better: Measured | None = None


@dataclass(frozen=True, slots=True)
class Rule:
    """When a claim holds: in words, and as a function of what was found."""

    text: str
    judge: Callable[[Measured, Measured | None], Verdict]


@dataclass(frozen=True, slots=True)
class Claim:
    """One sentence or cell.

    Attributes
    ----------
    section
        Of the thesis, with its title.
    place
        Where in it: a table, a figure, "text".
    says
        What is claimed, in our words.
    printed
        Its value as printed.
    chapter
        Stem of the notebook that looks into it.
    results
        Names of the stored results that it is held against; of none where a chapter computes it.
    rule, measure
        The rule, and what reads the results' contents. None without results.
    why
        Of a claim without results: what the chapter shows.
    """

    section: str
    place: str
    says: str
    printed: str
    chapter: str
    results: tuple[str, ...] = ()
    rule: Rule | None = None
    measure: Callable[[Stored], Found] | None = None
    why: str = ""

    def __post_init__(self) -> None:
        measured = (bool(self.results), self.rule is not None, self.measure is not None, not self.why)
        if len(set(measured)) > 1:
            raise InvalidParameterError(
                f"a claim names its results, a rule and a measurement, or says why it has none; {self.says!r} does both"
            )


def of_mean(told: Mapping[str, Any], unit: str = "deg", scale: float = 1.0) -> Measured:
    """From a stored :class:`gvp_lib.evaluation.statistics.Summary`."""
    interval = told["interval"]
    low, high = (None if interval[end] is None else scale * interval[end] for end in ("low", "high"))
    sd = None if told["sd"] is None else scale * told["sd"]
    return Measured(scale * told["mean"], told["n"], low, high, unit, sd)


def of_rate(told: Mapping[str, Any]) -> Measured:
    """From a stored count of successes with its Wilson interval, in per cent."""
    interval = told["interval"]
    return Measured(100 * told["rate"], told["n"], 100 * interval["low"], 100 * interval["high"], "%")


def more_than(limit: float, unit: str) -> Rule:
    """For what should be large."""

    def judge(ours: Measured, beside: Measured | None) -> Verdict:
        low, high = _ends(ours)
        return Verdict.HOLDS if low > limit else Verdict.FAILS if high < limit else Verdict.OPEN

    return Rule(f"the whole interval lies above {limit:g}{_unit(unit)}", judge)


def at_most(limit: float, unit: str) -> Rule:
    """For what should be small."""

    def judge(ours: Measured, beside: Measured | None) -> Verdict:
        low, high = _ends(ours)
        return Verdict.HOLDS if high <= limit else Verdict.FAILS if low > limit else Verdict.OPEN

    return Rule(f"the whole interval lies at or below {limit:g}{_unit(unit)}", judge)


def agrees(text: str = "the two intervals overlap") -> Rule:
    """For what should be the same."""

    def judge(ours: Measured, beside: Measured | None) -> Verdict:
        return Verdict.HOLDS if _order(ours, beside) == 0 else Verdict.FAILS

    return Rule(text, judge)


def no_worse(*, larger_is_better: bool) -> Rule:
    """For a cell of a table: as good as the thesis has it, or better."""

    def judge(ours: Measured, beside: Measured | None) -> Verdict:
        order = _order(ours, beside)
        if order == 0:
            return Verdict.HOLDS
        return Verdict.BETTER if (order > 0) == larger_is_better else Verdict.FAILS

    return Rule("ours and the thesis's intervals overlap, or ours is the better one", judge)


def below(text: str) -> Rule:
    """For what should be smaller than something else."""

    def judge(ours: Measured, beside: Measured | None) -> Verdict:
        order = _order(ours, beside)
        return Verdict.HOLDS if order < 0 else Verdict.FAILS if order > 0 else Verdict.OPEN

    return Rule(text, judge)


def above(text: str) -> Rule:
    """For what should be larger than something else."""

    def judge(ours: Measured, beside: Measured | None) -> Verdict:
        order = _order(ours, beside)
        return Verdict.HOLDS if order > 0 else Verdict.FAILS if order < 0 else Verdict.OPEN

    return Rule(text, judge)


def _ends(measured: Measured) -> tuple[float, float]:
    low = measured.value if measured.low is None else measured.low
    return low, measured.value if measured.high is None else measured.high


def _order(ours: Measured, beside: Measured | None) -> int:
    """-1 where ours lies below altogether, 1 above, 0 where the two intervals overlap."""
    if beside is None:
        raise InvalidParameterError("a rule that compares needs what the measurement is held against; got none")
    (low, high), (other_low, other_high) = _ends(ours), _ends(beside)
    return -1 if high < other_low else 1 if low > other_high else 0


def _unit(unit: str) -> str:
    return f" {unit}" if unit else ""
