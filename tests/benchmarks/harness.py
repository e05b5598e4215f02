"""Times rivals in turns, so that a busy machine is unfair to none of them, and prints their ratios."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Result:
    """Times of one rival.

    Attributes
    ----------
    name
        As given.
    median
        Median time of a call, s.
    ratio
        Median over the rounds of this rival's time to the first one's in the same round.
    """

    name: str
    median: float
    ratio: float


def interleave(rivals: Mapping[str, Callable[[], object]], rounds: int = 30, calls: int = 5) -> dict[str, Result]:
    """Time each rival in each round, ``calls`` times in a row, and compare with the first within the round.

    Ratios are taken within a round and their median over the rounds, because machines slow down for seconds at a
    time. Prints a table.
    """
    times: dict[str, list[float]] = {name: [] for name in rivals}
    for function in rivals.values():
        function()
    names = list(rivals)
    for k in range(rounds):
        turn = k % len(names)
        for name in names[turn:] + names[:turn]:
            start = time.perf_counter()
            for _ in range(calls):
                rivals[name]()
            times[name].append((time.perf_counter() - start) / calls)
    first = times[names[0]]
    results = {
        name: Result(
            name,
            statistics.median(own),
            statistics.median(a / b for a, b in zip(own, first, strict=True)),
        )
        for name, own in times.items()
    }
    width = max(map(len, names))
    print(f"{'':{width}}  median, ms  x {names[0]}")
    for result in results.values():
        print(f"{result.name:{width}}  {1e3 * result.median:10.3f}  {result.ratio:6.2f}")
    return results
