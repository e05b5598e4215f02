"""Times rivals in turns, so that a busy machine is unfair to none of them, and prints their ratios."""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import NamedTuple

Case = Callable[[], Callable[[], object]]
"""Prepares something once and returns what is then timed, again and again."""


class Result(NamedTuple):
    """A rival's median time, s, and the median over the rounds of its time to the first one's in the same round."""

    median: float
    ratio: float


def interleave(rivals: Mapping[str, Callable[[], object]], rounds: int = 30, calls: int = 5) -> dict[str, Result]:
    """Time each rival in each round, ``calls`` times in a row, and print a table."""

    def timed(name: str) -> float:
        start = time.perf_counter()
        for _ in range(calls):
            rivals[name]()
        return (time.perf_counter() - start) / calls

    for function in rivals.values():
        function()
    return _in_turns(timed, list(rivals), rounds)


def _in_turns(timed: Callable[[str], float], names: list[str], rounds: int) -> dict[str, Result]:
    """Each name once a round, each round beginning with the next.

    Ratios are taken within a round, because machines slow down for seconds at a time.
    """
    times: dict[str, list[float]] = {name: [] for name in names}
    for k in range(rounds):
        turn = k % len(names)
        for name in names[turn:] + names[:turn]:
            times[name].append(timed(name))
    first, width = times[names[0]], max(map(len, names))
    print(f"{'':{width}}  median, ms  x {names[0]}")
    results = {}
    for name, own in times.items():
        results[name] = Result(median(own), median(a / b for a, b in zip(own, first, strict=True)))
        print(f"{name:{width}}  {1e3 * results[name].median:10.3f}  {results[name].ratio:6.2f}")
    print(flush=True)
    return results


def verdict(what: str, value: float, aim: float, least: bool = False) -> None:
    """Print a figure and, where it misses what it should be at most, or at least, by how much."""
    missed = value < aim if least else value > aim
    print(f"{what}: {value:.2f}" + f", {'below' if least else 'above'} the aim of {aim}" * missed, flush=True)


def record(what: str, **found: float) -> None:
    """Add a figure to the file that ``GVP_BENCHMARKS`` names, a line of JSON each; nothing where it names none."""
    if file := os.environ.get("GVP_BENCHMARKS"):
        with Path(file).open("a") as lines:
            print(json.dumps({"what": what, **found}), file=lines)


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
        load = f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}"
        print(f"Python {platform.python_version()}, {platform.machine()}, {load}\n")
        main()


def against(checkout: Path, cases: Sequence[str], rounds: int) -> None:
    """Time this script's cases on another checkout's library and on ours, each in a process of its own; print tables.

    What counts is processor time, of all threads together, which other work on the machine changes least.
    """
    roots = {"theirs": checkout.resolve(), "ours": Path(__file__).resolve().parents[2]}
    for case in cases:
        print(f"{case}, processor time; theirs is {checkout}")
        workers = {name: _worker(root, case) for name, root in roots.items()}

        def timed(name: str, workers: Mapping[str, subprocess.Popen[str]] = workers) -> float:
            print(file=workers[name].stdin, flush=True)
            return float(_reply(workers[name]))

        found = _in_turns(timed, list(workers), rounds)
        for worker in workers.values():
            worker.communicate()  # closes its input
        record(case, before_s=found["theirs"].median, now_s=found["ours"].median, ratio=found["ours"].ratio)


def _worker(root: Path, case: str) -> subprocess.Popen[str]:
    """This script once more, on the library of one checkout: it times its case whenever it is sent a line."""
    worker = subprocess.Popen(
        [sys.executable, sys.argv[0], "--serve", case],
        env=os.environ | {"PYTHONPATH": str(root)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    library = Path(_reply(worker))
    if not library.is_relative_to(root):
        raise SystemExit(f"{root} holds no gvp_lib: {library} was imported instead")
    return worker


def _reply(worker: subprocess.Popen[str]) -> str:
    assert worker.stdout is not None
    if not (line := worker.stdout.readline()):
        raise SystemExit(f"a worker ended with {worker.wait()}; its error stands above")
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
