"""What the thesis claims of grasping. Abstract, 2.3, 3.1.5, 3.1.7, Table 3.2, 4."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from gvp_book.claims.alignment import NAMES
from gvp_book.claims.claim import (
    Claim,
    Found,
    Measured,
    Rule,
    Stored,
    Verdict,
    above,
    at_most,
    more_than,
    no_worse,
    of_mean,
    of_rate,
)
from gvp_book.experiments.grasp_judgement import Cause
from gvp_book.experiments.grasping import THESIS, THESIS_TRIALS
from gvp_lib.evaluation.statistics import wilson_interval

__all__ = ["CLAIMS", "counted"]

TABLE = "table-3.2"
SENSOR = (Cause.TOO_EARLY, Cause.NEVER_CLOSED)


def counted(successes: int, n: int) -> Measured:
    """A rate of our own counting, in per cent."""
    interval = wilson_interval(successes, n)
    return Measured(100 * successes / n if n else 0.0, n, 100 * interval.low, 100 * interval.high, "%")


def _sum(tallies: Iterable[Mapping[str, Any]]) -> Measured:
    told = list(tallies)
    return counted(sum(each["successes"] for each in told), sum(each["n"] for each in told))


def _placements(stored: Stored, target: str) -> list[str]:
    """The two that stand for the thesis's, in its order (Fig. 3.1)."""
    cases = (case.split("/") for case in stored[TABLE]["summary"])
    return [place for group, own, place in cases if (group, own) == ("thesis", target) and place != "tilted"]


def _tallies(stored: Stored, targets: Sequence[str], which: slice, method: str) -> list[Mapping[str, Any]]:
    summary = stored[TABLE]["summary"]
    return [summary[f"thesis/{t}/{place}"][method] for t in targets for place in _placements(stored, t)[which]]


def _causes(tallies: Iterable[Mapping[str, Any]]) -> Counter[str]:
    return sum((Counter(told["causes"]) for told in tallies), Counter())


def _cell(target: str, which: slice, stored: Stored) -> Found:
    theirs = list(THESIS[target])[which]
    ours, better = (_sum(_tallies(stored, [target], which, method)) for method in ("thesis", "ours"))
    told = _causes(_tallies(stored, [target], which, "thesis")).most_common(2)
    places = " and ".join(_LIES[place] for place in _placements(stored, target)[which])
    why = f"It lies {places}. Most of its failures: {', '.join(f'{count} {cause}' for cause, count in told)}."
    return Found(ours, why, counted(sum(theirs), THESIS_TRIALS * len(theirs)), better)


_LIES = {"flat": "flat on the table", "raised": "level on a block", "side": "on its side"}


def _pooled(stored: Stored, group: str = "thesis") -> Mapping[str, Any]:
    pooled: Mapping[str, Any] = stored[TABLE]["pooled_thesis_placements"][group]
    return pooled


def _most_succeed(stored: Stored) -> Found:
    told = _pooled(stored)
    theirs = counted(sum(map(sum, THESIS.values())), 2 * THESIS_TRIALS * len(THESIS))
    why = (
        f"The thesis's hundred grasps allow {theirs.low:.0f} to {theirs.high:.0f} %. Our starts are random, 10 to 40 "
        f"deg off at any roll; its planner ends {told['thesis']['error']['median']:.1f} deg off in the median."
    )
    return Found(of_rate(told["thesis"]), why, theirs, of_rate(told["ours"]))


def _rgb_suffices(stored: Stored) -> Found:
    told = _pooled(stored)
    short = of_mean(told["oracle - ours"], "points", 100)
    why = (
        f"From {told['oracle']['n']} of the same starts, an oracle that is told the object's pose grasps "
        f"{100 * told['oracle']['rate']:.1f} %, which is {short.value:+.1f} [{short.low:+.1f}, {short.high:+.1f}] "
        "points from ours. That is what a further sensor could still add, on objects like these."
    )
    return Found(of_rate(told["thesis"]), why, short, of_rate(told["ours"]))


def _within_points(limit: float) -> Rule:
    def judge(ours: Measured, beside: Measured | None) -> Verdict:
        high = beside.high if beside is not None else None
        return Verdict.OPEN if high is None else Verdict.HOLDS if high <= limit else Verdict.FAILS

    return Rule(f"our planner, with an RGB camera alone, is at most {limit:g} points behind an oracle", judge)


def _any_orientation(stored: Stored) -> Found:
    level, every = _pooled(stored), stored[TABLE]["pooled"]["thesis"]
    leaning = {
        method: counted(*(every[method][field] - level[method][field] for field in ("successes", "n")))
        for method in ("thesis", "ours")
    }
    why = f"Objects that lean by 15 to 30 deg, which the thesis has not; of level ones {of_rate(level['thesis'])}."
    return Found(leaning["thesis"], why, of_rate(level["thesis"]), leaning["ours"])


def _stacking(stored: Stored) -> Found:
    flat, other = (_sum(_tallies(stored, list(THESIS), slice(k, k + 1), "thesis")) for k in (0, 1))
    better = _sum(_tallies(stored, list(THESIS), slice(1, 2), "ours"))
    theirs = [counted(sum(counts[k] for counts in THESIS.values()), THESIS_TRIALS * len(THESIS)) for k in (0, 1)]
    why = f"Flat on the table {flat}. The thesis has {theirs[0].value:.0f} % there and {theirs[1].value:.0f} % here."
    return Found(other, why, flat, better)


def _not_fewer() -> Rule:
    rule = no_worse(larger_is_better=True)

    def judge(ours: Measured, beside: Measured | None) -> Verdict:
        return Verdict.FAILS if rule.judge(ours, beside) is Verdict.FAILS else Verdict.HOLDS

    return Rule("the interval is not altogether below that of the others", judge)


def _off_but_held(stored: Stored) -> Found:
    pairs = [
        pair
        for case, row in stored[TABLE]["rows"].items()
        if case.startswith("thesis/") and not case.endswith("/tilted")
        for pair in zip(row["thesis"]["error"], row["thesis"]["success"], strict=True)
    ]
    off = [held == "1" for error, held in pairs if error is not None and 10 <= error <= 20]
    near = [held == "1" for error, held in pairs if error is not None and error < 10]
    why = f"Of grasps from views 10 to 20 deg off. From nearer views it is {counted(sum(near), len(near))}."
    return Found(counted(sum(off), len(off)), why)


def _best_object(stored: Stored) -> Found:
    both = slice(0, 2)
    rates = {target: _sum(_tallies(stored, [target], both, "thesis")) for target in THESIS}
    others = {target: rate for target, rate in rates.items() if target != "cuboid_1x2"}
    best = max(others, key=lambda target: others[target].value)
    why = f"The {NAMES[best]} has {others[best]}. With the thesis's twenty trials each, no order of objects is certain."
    return Found(rates["cuboid_1x2"], why, others[best], _sum(_tallies(stored, ["cuboid_1x2"], both, "ours")))


def _sensors_fault(stored: Stored) -> Found:
    told = _pooled(stored)
    failures = told["thesis"]["n"] - told["thesis"]["successes"]
    sensor = sum(told["thesis"]["causes"].get(cause, 0) for cause in SENSOR)
    fit = told["fit, threshold"]
    left, by_it = fit["n"] - fit["successes"], sum(fit["causes"].get(cause, 0) for cause in SENSOR)
    view = told["thesis"]["causes"].get(Cause.MISALIGNED, 0)
    agreed = "it is as the thesis says" if 2 * by_it > left else "it is not so either"
    why = (
        f"Of {failures} failures {sensor} are the sensor's and {view} the view's. Once the view is right, with our fit "
        f"in place of its own, {agreed}: {by_it} of {left}."
    )
    return Found(counted(sensor, failures), why)


def _alligator(stored: Stored) -> Found:
    return _cell("alligator", slice(0, 2), stored)


def _placement(stored: Stored) -> Found:
    told = _pooled(stored)
    ours, better = (of_mean(told[method]["tilt_in_hand"]) for method in ("thesis", "ours"))
    why = (
        f"How far what was lifted leans in the hand: in the median {told['thesis']['tilt_in_hand']['median']:.1f} deg, "
        f"and {told['ours']['tilt_in_hand']['median']:.1f} deg with ours. A grasp from a wrong view may well hold."
    )
    return Found(ours, why, better=better)


_CHAPTER = "04_grasping"
_FIRST, _SECOND, _BOTH = slice(0, 1), slice(1, 2), slice(0, 2)
_ORIENTATIONS = (("orientation 1", _FIRST), ("orientation 2", _SECOND), ("overall", _BOTH))

CLAIMS = (
    Claim("Abstract", "text", "The first planner grasps more than 80 % of the time", "> 80 %", _CHAPTER, (TABLE,),
          more_than(80, "%"), _most_succeed),
    Claim("Abstract", "text", "An RGB camera is sufficient to plan viewpoints and grasp simple, novel objects", "",
          _CHAPTER, (TABLE,), _within_points(2), _rgb_suffices),
    Claim("2.3", "text", "Simple objects are grasped regardless of their orientation", "", _CHAPTER, (TABLE,),
          _not_fewer(), _any_orientation),
    Claim("3.1.5", "text", "The framework does well on objects that are no simple solids, such as the alligator",
          "85 %", _CHAPTER, (TABLE,), no_worse(larger_is_better=True), _alligator),
    *(Claim("3.1.7", "Table 3.2", f"Grasps of the {NAMES[target]}, {name}",
            f"{100 * np.mean(counts[which]) / THESIS_TRIALS:.0f} %", _CHAPTER, (TABLE,),
            no_worse(larger_is_better=True), partial(_cell, target, which))
      for target, counts in THESIS.items() for name, which in _ORIENTATIONS),
    Claim("3.1.7", "text", "Alignments off by up to 20 deg can still end in a good grasp", "20 deg", _CHAPTER,
          (TABLE,), more_than(50, "%"), _off_but_held),
    Claim("3.1.7", "text", "The 1x2 brick has the most successful grasps", "95 %", _CHAPTER, (TABLE,),
          above("its interval lies above that of the best other object"), _best_object),
    Claim("3.1.7", "text", "An object that stands on another is not grasped significantly less often", "", _CHAPTER,
          (TABLE,), _not_fewer(), _stacking),
    Claim("3.1.7", "text", "Most failures come from the noisy IR sensor, not from the alignment", "> 50 %", _CHAPTER,
          (TABLE,), more_than(50, "%"), _sensors_fault),
    Claim("4", "text", "Objects are held in an orientation that makes them easy to place", "", _CHAPTER, (TABLE,),
          at_most(5, "deg"), _placement),
)  # fmt: skip
"""In the thesis's order."""
