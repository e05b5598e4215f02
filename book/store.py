"""Take the outputs of the notebooks' copies into ``notebooks/``: what ``make store`` does, for the authors.

    python book/store.py             # run what is not up to date, then store all of it
    python book/store.py --heads     # run nothing; write only what a chapter's head says of itself

What says the same as what is stored is left as it is: a number that differs in its last digits on another processor, a
picture in which another renderer has moved an edge. So a diff shows results.
"""

from __future__ import annotations

import argparse
import base64
import platform
import re
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import cv2
import nbformat
import numpy as np
from execute import chapters, code_cells, copy_of, cores, run_all
from nbformat import NotebookNode
from numpy.typing import NDArray
from skeleton import neighbors_line, reading_minutes, run_seconds, title

from gvp_lib.views.page import LAB_MIME, SCENE_MIME

NUMBER = re.compile(r"-?\d+\.?\d*(?:e[-+]?\d+)?")
ALIKE = 0.005  # relative difference of two numbers that say the same
VISIBLE, MOST_VISIBLE = 24, 0.005  # of 255, and the share of pixels that may differ by more


def store(paths: Iterable[Path]) -> None:
    """Write the outputs of the copies into the notebooks, and what their heads say of themselves."""
    for path in paths:
        notebook, copy = nbformat.read(path, as_version=4), nbformat.read(copy_of(path), as_version=4)
        for cell, ran in zip(code_cells(notebook), code_cells(copy), strict=True):
            if not say_the_same(cell.outputs, ran.outputs):
                cell.outputs = ran.outputs
            cell.execution_count = ran.execution_count
        seconds = copy.metadata.pop("gvp")["seconds"]
        notebook.metadata = copy.metadata
        tell_run_time(notebook, seconds)
        tell_head(notebook, path)
        nbformat.write(notebook, path)


# --- whether outputs say the same -------------------------------------------------------------------------------------


def say_the_same(stored: Sequence[NotebookNode], new: Sequence[NotebookNode]) -> bool:
    """Whether two cells' outputs are of the same kinds, with the same words, and alike in numbers and pictures."""
    return len(stored) == len(new) and all(alike(a, b, "") for a, b in zip(stored, new, strict=True))


def alike(a: Any, b: Any, kind: str) -> bool:
    """The same of any part of an output; ``kind`` is the name that it stands under."""
    if kind == "execution_count":
        return True
    if kind == "image/png":
        return alike_pictures(a, b)
    if kind in (SCENE_MIME, LAB_MIME):  # its still is compared as a picture; so here, whether it has as much in it
        ours, theirs = (len(each["scene"]) for each in (a, b))
        return abs(ours - theirs) <= ALIKE * ours
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(alike(a[key], b[key], key) for key in a)
    return alike_texts(a, b) if isinstance(a, str) and isinstance(b, str) else bool(a == b)


def alike_texts(a: str, b: str) -> bool:
    """The same words, and numbers that differ in their last digits at most."""
    if NUMBER.sub("#", a) != NUMBER.sub("#", b):
        return False
    pairs = zip(NUMBER.findall(a), NUMBER.findall(b), strict=True)
    return all(x == y or abs(float(x) - float(y)) <= ALIKE * abs(float(x)) for x, y in pairs)


def alike_pictures(a: str, b: str) -> bool:
    """No more than a few pixels differ visibly; the pictures in base64."""
    one, other = decoded(a), decoded(b)
    if one.shape != other.shape:
        return False
    return bool(np.mean(np.abs(one.astype(int) - other).max(axis=-1) > VISIBLE) <= MOST_VISIBLE)


def decoded(png: str) -> NDArray[np.uint8]:
    """A picture's pixels, shape (height, width, 3)."""
    return np.asarray(cv2.imdecode(np.frombuffer(base64.b64decode(png), np.uint8), cv2.IMREAD_COLOR), np.uint8)


# --- heads ------------------------------------------------------------------------------------------------------------


def tell_run_time(notebook: NotebookNode, seconds: float) -> None:
    """Write the measured time into the line ``**Run time:** ...`` of the first cell."""
    # In steps of five, and only where it is clearly another: a second more or less does not change the page.
    about = max(5, 5 * round(seconds / 5))
    stored = run_seconds(notebook)
    if stored and about / 1.25 <= stored <= 1.25 * about:
        return
    told = f"**Run time:** about {about} s, as measured on {cores()} {platform.machine()} cores."
    notebook.cells[0].source = re.sub(r"\*\*Run time:\*\*.*", told, notebook.cells[0].source)


def tell_head(notebook: NotebookNode, path: Path) -> None:
    """Write the reading time and the way to the neighbors, which follow from the text, into the first cell."""
    head = notebook.cells[0]
    told = f"**Reading time:** about {reading_minutes(notebook)} min, the exercises not counted."
    head.source = re.sub(r"\*\*Reading time:\*\*.*", told, head.source)
    titles = {each: title(nbformat.read(each, as_version=4)) for each in chapters()}
    head.source = re.sub(r"^← .*", neighbors_line(path, chapters(), titles), head.source, flags=re.MULTILINE)


def write_head(path: Path) -> None:
    """Bring a notebook's head up to date without running it."""
    notebook = nbformat.read(path, as_version=4)
    tell_head(notebook, path)
    nbformat.write(notebook, path)


def main() -> int:
    """Store, or write heads alone."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--heads", action="store_true", help="run nothing; write what the heads say of themselves")
    parser.add_argument("--workers", type=int, default=cores(), metavar="N", help="how many notebooks run at once")
    told = parser.parse_args()
    if told.heads:
        for path in chapters():
            write_head(path)
    elif run_all(chapters(), told.workers):
        store(chapters())
    else:
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
