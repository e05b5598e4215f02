"""This version against 0.1, on one machine, one after the other: what `make bench` runs, and the book shows.

    python tests/benchmarks/versions.py            # all of it: an hour and more
    python tests/benchmarks/versions.py capture plan        # some of it, kept beside what was measured before

The verbs are timed in fresh clones of both versions, set up beforehand, with nothing of the caller's environment set.
What takes less than a minute is timed in turns, each library in a process of its own, by processor time. Writes
``book/results/benchmarks.json``, and prints the tables of the other benchmarks of this folder.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from gvp_book.results import read_result, rounded, write_result
from gvp_lib.errors import ResultError

FOLDER = Path(__file__).resolve().parent
ROOT = FOLDER.parents[1]
RESULT = ROOT / "book" / "results" / "benchmarks.json"
BEFORE = "5664d32"  # version 0.1
OURS = ("GVP_", "PYTEST_", "MUJOCO_", "OMP_", "OPENBLAS_", "LP_")  # variables that a newcomer has not set

Row = dict[str, Any]


class Clones(NamedTuple):
    """Fresh clones of both versions."""

    before: Path
    now: Path


def run(command: list[str], folder: Path) -> str:
    """The output of a command in a folder, as a newcomer would call it."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(OURS)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)} in {folder} failed:\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}")
    return done.stdout.strip()


def seconds(verb: str, clone: Path) -> float:
    """How long one call of a verb takes, in a clone that is set up."""
    run(["make", "setup"], clone)
    start = time.perf_counter()
    run(["make", verb], clone)
    return time.perf_counter() - start


def compared(verb: str, clones: Clones) -> list[Row]:
    """A verb that both versions have, in its first call."""
    before, now = (seconds(verb, clone) for clone in clones)
    return [{"what": f"`make {verb}`, set up", "before_s": before, "now_s": now, "ratio": now / before}]


def alone(verb: str, what: str, clones: Clones) -> list[Row]:
    """A verb, or a call of one, that 0.1 did not have."""
    return [{"what": what, "now_s": seconds(verb, clones.now)}]


def in_turns(program: str, clones: Clones) -> list[Row]:
    """The cases of a program that times a library, both versions in turns."""
    return of_program(program, "--against", str(clones.before))


def tables(_: Clones) -> list[Row]:
    """The tables of all other programs, printed; what they record is kept."""
    programs = sorted({path.name for path in FOLDER.glob("*.py")} - {"harness.py", Path(__file__).name})
    return [row for program in programs for row in of_program(program)]


def of_program(program: str, *arguments: str) -> list[Row]:
    """What a program of this folder records; it prints its tables."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "rows"
        command = [sys.executable, str(FOLDER / program), *arguments]
        subprocess.run(command, env=os.environ | {"GVP_BENCHMARKS": str(file)}, check=True)
        return [json.loads(line) for line in file.read_text("utf-8").splitlines()] if file.exists() else []


MEASURES: dict[str, Callable[[Clones], list[Row]]] = {
    "capture": partial(in_turns, "capture.py"),
    "plan": partial(in_turns, "planning.py"),
    "tables": tables,
    "book": partial(compared, "book"),
    "book-again": partial(alone, "book", "`make book` again, nothing changed"),
    "html": partial(alone, "html", "`make html` after it"),
    "check": partial(alone, "check", "`make check`"),
    "test": partial(compared, "test"),
    "full": partial(alone, "full", "what `make test-all` has beyond `make test`"),
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
        clones = Clones(Path(folder) / "before", Path(folder) / "now")
        for clone, commit in zip(clones, (BEFORE, "HEAD"), strict=True):
            run(["git", "clone", "--quiet", "--no-checkout", str(ROOT), str(clone)], ROOT)
            run(["git", "checkout", "--quiet", run(["git", "rev-parse", commit], ROOT)], clone)
        for name in (name for name in MEASURES if name in names):
            rows[name] = MEASURES[name](clones)
            print(name, *rows[name], sep="\n  ", flush=True)
            write_result(
                RESULT, name="benchmarks", command="make bench", seeds=[], replayed="nothing: times are the machine's",
                content={"before": BEFORE, "rows": rounded({key: rows[key] for key in MEASURES if key in rows}, 3)},
            )  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
