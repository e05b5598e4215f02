"""Run every notebook live and store its outputs in it: the first half of ``make book``.

    python book/execute.py                     # all chapters
    python book/execute.py notebooks/01_*.ipynb
    python book/execute.py --heads             # run nothing; write only what a chapter's head says of itself

A notebook runs in a fresh kernel of this interpreter, in its own folder. Only a notebook that ran to its end is
written, without what changes from run to run (times, addresses, widgets' states), so that a diff shows results.
"""

from __future__ import annotations

import os
import platform
import re
import sys
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError
from skeleton import neighbors_line, reading_minutes, title

from gvp_lib.views.page import SCENE_MIME

ROOT = Path(__file__).resolve().parent.parent
WIDGET = "application/vnd.jupyter.widget-view+json"


def execute(path: Path) -> float:
    """Run one notebook and store it; returns the seconds it took."""
    notebook = nbformat.read(path, as_version=4)
    start = time.perf_counter()
    client = NotebookClient(
        notebook,
        timeout=600,
        kernel_name="python3",
        record_timing=False,
        coalesce_streams=True,  # how a stream was cut into pieces is chance
        extra_arguments=["--log-level=ERROR"],  # a kernel on the loopback warns that it does not encrypt
        resources={"metadata": {"path": str(path.parent)}},
    )
    client.execute()
    seconds = time.perf_counter() - start
    tidy(notebook)
    tell_run_time(notebook, seconds)
    tell_head(notebook, path)
    nbformat.write(notebook, path)
    return seconds


def tidy(notebook: nbformat.NotebookNode) -> None:
    """Drop what means nothing once the kernel has stopped."""
    notebook.metadata.pop("widgets", None)
    notebook.metadata["kernelspec"] = {"display_name": "Python 3", "language": "python", "name": "python3"}
    notebook.metadata["language_info"] = {"name": "python"}
    for cell in notebook.cells:
        if cell.cell_type != "code":
            continue
        cell.outputs = [output for output in cell.outputs if WIDGET not in output.get("data", {})]
        for output in cell.outputs:
            if SCENE_MIME in output.get("data", {}):
                output.data.pop("text/html", None)  # an address on the kernel that has gone


def tell_run_time(notebook: nbformat.NotebookNode, seconds: float) -> None:
    """Write the measured time into the line ``**Run time:** ...`` of the first cell."""
    # In steps of five, so that a second more or less does not change the page.
    about = max(5, 5 * round(seconds / 5))
    told = f"**Run time:** about {about} s, as measured on {os.cpu_count()} {platform.machine()} cores."
    head = notebook.cells[0]
    # Nor does a machine somewhat slower or faster: running the book leaves a clone clean.
    stored = re.search(r"\*\*Run time:\*\* about (\d+) s", head.source)
    if stored and about / 2 <= int(stored[1]) <= 2 * about:
        return
    head.source = re.sub(r"\*\*Run time:\*\*.*", told, head.source)


def tell_head(notebook: nbformat.NotebookNode, path: Path) -> None:
    """Write the reading time and the way to the neighbors, which follow from the text, into the first cell."""
    head = notebook.cells[0]
    told = f"**Reading time:** about {reading_minutes(notebook)} min, the exercises not counted."
    head.source = re.sub(r"\*\*Reading time:\*\*.*", told, head.source)
    chapters = sorted(path.parent.glob("*.ipynb"))
    titles = {each: title(nbformat.read(each, as_version=4)) for each in chapters}
    head.source = re.sub(r"^← .*", neighbors_line(path, chapters, titles), head.source, flags=re.MULTILINE)


def write_head(path: Path) -> None:
    """Bring a notebook's head up to date without running it."""
    notebook = nbformat.read(path, as_version=4)
    tell_head(notebook, path)
    nbformat.write(notebook, path)


def main() -> int:
    """Run the notebooks named, or all; stops at the first that fails."""
    os.environ.setdefault("JUPYTER_PREFER_ENV_PATH", "1")  # this environment's kernel, not the user's
    named = [Path(name).resolve() for name in sys.argv[1:] if name != "--heads"]
    paths = named or sorted((ROOT / "notebooks").glob("*.ipynb"))
    if "--heads" in sys.argv:
        for path in paths:
            write_head(path)
        return 0
    for path in paths:
        try:
            print(f"{path.name}: {execute(path):.0f} s", flush=True)
        except CellExecutionError as error:
            print(f"{path.name} failed; it was left as it is.\n{error}", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
