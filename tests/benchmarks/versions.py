"""This version against 0.1, on one machine, one after the other: what `make bench` runs, and the book shows.

    python tests/benchmarks/versions.py            # all of it: an hour and more
    python tests/benchmarks/versions.py capture plan        # some of it, kept beside what was measured before

The verbs are timed in fresh clones of both versions, set up beforehand, with nothing of the caller's environment set.
What takes less than a minute is timed in turns, process by process. Writes ``book/results/benchmarks.json``.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness import against

from gvp_lib.errors import ResultError
from gvp_lib.experiments.results import read_result, rounded, write_result

ROOT = Path(__file__).resolve().parents[2]
RESULT = ROOT / "book" / "results" / "benchmarks.json"
BEFORE = "5664d32"  # version 0.1
OURS = ("GVP_", "PYTEST_", "MUJOCO_", "OMP_", "OPENBLAS_", "LP_")  # variables that a newcomer has not set

Row = dict[str, Any]


@dataclass(frozen=True)
class Clones:
    """Fresh clones of both versions, set up."""

    before: Path
    now: Path

    @classmethod
    def below(cls, folder: Path) -> Clones:
        """Make them."""
        for name, commit in (("before", BEFORE), ("now", "HEAD")):
            run(["git", "clone", "--quiet", "--no-checkout", str(ROOT), name], folder)
            resolved = run(["git", "rev-parse", commit], ROOT)
            run(["git", "checkout", "--quiet", resolved], folder / name)
            run(["make", "setup"], folder / name)
        return cls(folder / "before", folder / "now")


def run(command: list[str], folder: Path) -> str:
    """The output of a command in a folder, as a newcomer would call it."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(OURS)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)} in {folder} failed:\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}")
    return done.stdout.strip()


def seconds(verb: str, clone: Path) -> float:
    """How long one call of a verb takes."""
    start = time.perf_counter()
    run(["make", verb], clone)
    return time.perf_counter() - start


def compared(verb: str) -> Callable[[Clones], Row]:
    """A verb that both versions have, in its first call."""

    def measure(clones: Clones) -> Row:
        before, now = seconds(verb, clones.before), seconds(verb, clones.now)
        return {"before_s": before, "now_s": now, "ratio": now / before}

    return measure


def alone(verb: str) -> Callable[[Clones], Row]:
    """A verb, or a call of one, that 0.1 did not have."""
    return lambda clones: {"now_s": seconds(verb, clones.now)}


def in_turns(program: str) -> Callable[[Clones], Row]:
    """A program that measures a library by itself: both versions in turns, by the ratio of their processor times."""
    return lambda clones: against(Path(__file__).parent / program, clones.before, clones.now)


MEASURES: dict[str, tuple[str, Callable[[Clones], Row]]] = {
    "capture": ("A picture in the full cell, the sky out of view", in_turns("capture.py")),
    "plan": ("A plan under noise on Baxter, its fit included", in_turns("planning.py")),
    "book": ("`make book`, set up", compared("book")),
    "book-again": ("`make book` again, nothing changed", alone("book")),
    "html": ("`make html`, after `make book`", alone("html")),
    "check": ("`make check`", alone("check")),
    "test": ("`make test`, set up", compared("test")),
    "full": ("what `make test-all` has beyond `make test`", alone("full")),
}


def main() -> int:
    """Measure, print, store."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="name", help=f"of {', '.join(MEASURES)} (default: all)")
    names = parser.parse_args().names or list(MEASURES)
    if unknown := set(names) - set(MEASURES):
        parser.error(f"nothing is measured under {', '.join(sorted(unknown))}; there are: {', '.join(MEASURES)}")
    try:
        rows = read_result(RESULT)["content"]["rows"]
    except ResultError:
        rows = {}
    with tempfile.TemporaryDirectory() as folder:
        clones = Clones.below(Path(folder))
        for name in (name for name in MEASURES if name in names):
            what, measure = MEASURES[name]
            rows[name] = {"what": what, **measure(clones)}
            print(name, rows[name], flush=True)
            write_result(
                RESULT, name="benchmarks", command="make bench", seeds=[], replayed="nothing: times are the machine's",
                content={"before": BEFORE, "rows": rounded({key: rows[key] for key in MEASURES if key in rows}, 3)},
            )  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
