"""Times rivals in turns, so that a busy machine is unfair to none of them, and prints their ratios."""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

Case = Callable[[], Callable[[], object]]
"""Prepares something once and returns what is then timed, again and again."""


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
    for name in _in_turns(list(rivals), rounds):
        start = time.perf_counter()
        for _ in range(calls):
            rivals[name]()
        times[name].append((time.perf_counter() - start) / calls)
    return _printed(times)


def command(main: Callable[[], None], cases: Mapping[str, Case]) -> None:
    """Run a benchmark from the command line: ``main``, or with ``--against`` its cases on two libraries in turns."""
    parser = argparse.ArgumentParser(description=sys.modules["__main__"].__doc__)
    parser.add_argument("--against", type=Path, metavar="CHECKOUT", help="time another checkout's library beside ours")
    parser.add_argument("--rounds", type=int, default=12, help="of that comparison")
    parser.add_argument("--case", choices=cases, action="append", help="of that comparison; all by default")
    parser.add_argument("--serve", choices=cases, help=argparse.SUPPRESS)  # be one side of it
    arguments = parser.parse_args()
    if arguments.serve is not None:
        _serve(cases[arguments.serve])
    elif arguments.against is not None:
        against(arguments.against, arguments.case or list(cases), arguments.rounds)
    else:
        main()


def against(checkout: Path, cases: Sequence[str], rounds: int = 12) -> dict[str, dict[str, Result]]:
    """Time this script's cases on another checkout's library and on ours, each in a process of its own; print tables.

    What counts is processor time, of all threads together, which other work on the machine changes least.
    """
    roots = {"theirs": checkout.resolve(), "ours": Path(__file__).resolve().parents[2]}
    results = {}
    for case in cases:
        workers = {name: _Worker(root, case) for name, root in roots.items()}
        times: dict[str, list[float]] = {name: [] for name in workers}
        for name in _in_turns(list(workers), rounds):
            times[name].append(workers[name].time())
        for worker in workers.values():
            worker.end()
        print(f"{case}, processor time; theirs is {checkout}")
        results[case] = found = _printed(times)
        print(flush=True)
        record(case, before_s=found["theirs"].median, now_s=found["ours"].median, ratio=found["ours"].ratio)
    return results


def record(what: str, **found: float) -> None:
    """Add a figure to the file that ``GVP_BENCHMARKS`` names, a line of JSON each; nothing where it names none."""
    if file := os.environ.get("GVP_BENCHMARKS"):
        with Path(file).open("a") as lines:
            print(json.dumps({"what": what, **found}), file=lines)


class _Worker:
    """This script once more, on the library of one checkout: it times its case whenever it is sent a line."""

    def __init__(self, root: Path, case: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, sys.argv[0], "--serve", case],
            env=os.environ | {"PYTHONPATH": str(root)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        library = Path(self._reply())
        if not library.is_relative_to(root):
            raise SystemExit(f"{root} holds no gvp_lib: {library} was imported instead")

    def time(self) -> float:
        """Processor time of one call, s."""
        assert self._process.stdin is not None
        print(file=self._process.stdin, flush=True)
        return float(self._reply())

    def end(self) -> None:
        self._process.communicate()  # closes its input

    def _reply(self) -> str:
        assert self._process.stdout is not None
        if not (line := self._process.stdout.readline()):
            raise SystemExit(f"a worker ended with {self._process.wait()}; its error stands above")
        return line.strip()


def _serve(case: Case) -> None:
    import gvp_lib

    print(gvp_lib.__file__, flush=True)
    function = case()
    function()
    for _ in sys.stdin:
        start = time.process_time()
        function()
        print(time.process_time() - start, flush=True)


def _in_turns(names: list[str], rounds: int) -> Iterator[str]:
    """Each name once a round, each round beginning with the next."""
    for k in range(rounds):
        turn = k % len(names)
        yield from names[turn:] + names[:turn]


def _printed(times: Mapping[str, list[float]]) -> dict[str, Result]:
    """The rivals' results, compared with the first; printed as a table."""
    first = next(iter(times))
    results = {
        name: Result(
            name,
            statistics.median(own),
            statistics.median(a / b for a, b in zip(own, times[first], strict=True)),
        )
        for name, own in times.items()
    }
    width = max(map(len, times))
    print(f"{'':{width}}  median, ms  x {first}")
    for result in results.values():
        print(f"{result.name:{width}}  {1e3 * result.median:10.3f}  {result.ratio:6.2f}")
    return results
