"""Times rivals in turns, so that a busy machine is unfair to none of them, and prints their ratios."""

from __future__ import annotations

import argparse
import gc
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from timeit import timeit
from typing import NamedTuple

Case = Callable[[], Callable[[], object]]
"""Prepares something once and returns what is then timed, again and again."""


class Result(NamedTuple):
    """A rival's median time, s, and the median over the rounds of its time to the first one's in the same round."""

    median: float
    ratio: float


def interleave(rivals: Mapping[str, Callable[[], object]], rounds: int = 30, calls: int = 5) -> dict[str, Result]:
    """Time each rival in each round, ``calls`` times in a row, and print a table."""
    for function in rivals.values():
        function()
    return _in_turns({name: partial(timeit, rivals[name], gc.enable, number=calls) for name in rivals}, rounds, calls)


def _in_turns(timed: Mapping[str, Callable[[], float]], rounds: int, calls: int = 1) -> dict[str, Result]:
    """Call each once a round, each round beginning with the next; each returns its time, s, for so many calls.

    Ratios are taken within a round, because machines slow down for seconds at a time.
    """
    names = list(timed)
    times: dict[str, list[float]] = {name: [] for name in names}
    for k in range(rounds):
        turn = k % len(names)
        for name in names[turn:] + names[:turn]:
            times[name].append(timed[name]() / calls)
    first, width = times[names[0]], max(map(len, names))
    print(f"{'':{width}}  median, ms  x {names[0]}")
    results = {}
    for name, own in times.items():
        results[name] = Result(median(own), median(a / b for a, b in zip(own, first, strict=True)))
        print(f"{name:{width}}  {1e3 * results[name].median:10.3f}  {results[name].ratio:6.2f}")
    print(flush=True)
    return results


def verdict(what: str, value: float, aim: float, least: bool = False) -> None:
    """Print a figure and, where it is above the most it should be, or below the least, that aim."""
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
        found = _in_turns({name: partial(_timed_by, worker) for name, worker in workers.items()}, rounds)
        for worker in workers.values():
            worker.communicate()  # closes its input
        record(case, before_s=found["theirs"].median, now_s=found["ours"].median, ratio=found["ours"].ratio)


def _worker(root: Path, case: str) -> subprocess.Popen[str]:
    """This script once more, on the library of one checkout: it times its case whenever it is sent a line."""
    command, pipe = [sys.executable, sys.argv[0], "--serve", case], subprocess.PIPE
    environment = os.environ | {"PYTHONPATH": str(root)}
    worker = subprocess.Popen(command, env=environment, stdin=pipe, stdout=pipe, text=True)
    if not (library := Path(_reply(worker))).is_relative_to(root):
        raise SystemExit(f"{root} holds no gvp_lib: {library} was imported instead")
    return worker


def _timed_by(worker: subprocess.Popen[str]) -> float:
    print(file=worker.stdin, flush=True)
    return float(_reply(worker))


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
        print(timeit(function, gc.enable, time.process_time, number=1), flush=True)
