"""What all chapters have in common, read from their notebooks: how long they are, and where their solutions stand.

A solution stands between two Markdown cells, ``:::{solution-start} label`` and ``:::{solution-end}``, with its code
cells in between. They hold nothing else, so a chapter without its solutions is the chapter without those cells.
CONTRIBUTING.md describes the skeleton; tests/book/test_chapters.py holds every chapter to it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

WORDS_PER_MINUTE = 200  # of prose
LINES_PER_MINUTE = 25  # of code
SOLUTION_START = re.compile(r"^:{3,}\{solution-start\} (\S+)$", re.MULTILINE)
SOLUTION_END = re.compile(r"^:{3,}\{solution-end\}$", re.MULTILINE)
BEFORE_THE_FIRST = "[Conventions](../book/conventions.md)"


class SkeletonError(ValueError):
    """A chapter is not built as all others are."""


def source(cell: dict[str, Any]) -> str:
    """A cell's text; notebooks store it as one string or as a list of lines."""
    return "".join(cell["source"])


def solution_cells(cells: Sequence[dict[str, Any]]) -> dict[str, range]:
    """Of each exercise, by its label, the cells of its solution, the gates included."""
    found: dict[str, range] = {}
    label, start = "", 0
    for number, cell in enumerate(cells):
        if cell["cell_type"] != "markdown":
            continue
        if opened := SOLUTION_START.search(source(cell)):
            if label:
                raise SkeletonError(f"cell {number} opens the solution of {opened[1]} within that of {label}")
            label, start = opened[1], number
        if SOLUTION_END.search(source(cell)):
            if not label:
                raise SkeletonError(f"cell {number} ends a solution that no cell before it opens")
            found[label], label = range(start, number + 1), ""
    if label:
        raise SkeletonError(f"the solution of {label} has no :::{{solution-end}}")
    return found


def without_solutions(notebook: dict[str, Any]) -> dict[str, Any]:
    """The same notebook for students: no solution, no output of one."""
    hidden = {number for cells in solution_cells(notebook["cells"]).values() for number in cells}
    kept = [cell for number, cell in enumerate(notebook["cells"]) if number not in hidden]
    told = next((cell for cell in kept if "{solution}" in source(cell)), None)
    if told is not None:
        raise SkeletonError(
            f"a solution would be left in the cell that begins {source(told)[:60]!r}; "
            "put it between :::{solution-start} and :::{solution-end}"
        )
    return {**notebook, "cells": kept}


def reading_minutes(notebook: dict[str, Any]) -> int:
    """How long the chapter takes to read, to five minutes, without its exercises."""
    words = lines = 0
    for cell in notebook["cells"]:
        text = source(cell)
        if cell["cell_type"] == "markdown" and re.search(r"^## Exercises$", text, re.MULTILINE):
            break
        if cell["cell_type"] == "markdown":
            words += len(text.split())
        else:
            lines += len(text.splitlines())
    return max(5, 5 * round((words / WORDS_PER_MINUTE + lines / LINES_PER_MINUTE) / 5))


def neighbors_line(path: Path, chapters: Sequence[Path], titles: dict[Path, str]) -> str:
    """The line of a chapter's head that leads to the chapter before it and to the one after it."""
    here = list(chapters).index(path)
    before, after = chapters[:here][-1:], chapters[here + 1 :][:1]
    links = [f"← [{titles[each]}]({each.name})" for each in before] or [f"← {BEFORE_THE_FIRST}"]
    links += [f"[{titles[each]}]({each.name}) →" for each in after]
    return " · ".join(links)


def title(notebook: dict[str, Any]) -> str:
    """The chapter's own title, the one heading of the first level."""
    return source(notebook["cells"][0]).partition("\n")[0].removeprefix("# ")


def run_seconds(notebook: dict[str, Any]) -> int:
    """How long the chapter takes to run, as its head says, s; 0 where it does not."""
    told = re.search(r"\*\*Run time:\*\* about (\d+) s", source(notebook["cells"][0]))
    return int(told[1]) if told else 0
