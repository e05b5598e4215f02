"""Run the notebooks live, several at a time: the first half of ``make book``.

    python book/execute.py                     # all chapters that are not up to date
    python book/execute.py notebooks/01_*.ipynb

A notebook runs in a fresh kernel of this interpreter, in its own folder; its outputs go to a copy in
``book/_build/notebooks``, so that a clone stays clean. It runs again only where its code, the library, a stored result
that it names, or the lock has changed. ``store.py`` takes the outputs into ``notebooks/``.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import cache
from itertools import chain
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, DeadKernelError
from nbformat import NotebookNode
from skeleton import run_seconds

from gvp_lib.views.page import LAB_MIME, SCENE_MIME

ROOT = Path(__file__).resolve().parent.parent
NOTEBOOKS = ROOT / "notebooks"
COPIES = ROOT / "book" / "_build" / "notebooks"
RESULTS = ROOT / "book" / "results"
LOCK = ROOT / "environment" / "lock.txt"
WIDGET = "application/vnd.jupyter.widget-view+json"
CELL_TIMEOUT = 600  # s
# What the libraries below a chapter take for the number of their threads: drawing, torch, BLAS, OpenCV.
THREADS = ("LP_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")


# --- running ----------------------------------------------------------------------------------------------------------


def run_all(paths: Sequence[Path], workers: int) -> bool:
    """Bring the copies of notebooks up to date; tells whether all of them ran to their ends."""
    stale = [path for path in paths if not is_current(path)]
    for path in paths:
        if path not in stale:
            refresh(path)
    if done := len(paths) - len(stale):
        print(f"{done} of {len(paths)} chapters are up to date", flush=True)
    failed = False
    workers = min(workers, len(stale))
    # Those that take longest first, so that none of them is left running alone.
    stale.sort(key=lambda path: run_seconds(nbformat.read(path, as_version=4)), reverse=True)
    share_cores(workers)
    with ProcessPoolExecutor(max(workers, 1)) as pool:
        running = {pool.submit(run, path): path for path in stale}
        try:
            for future in as_completed(running):
                path, (seconds, error) = running[future], future.result()
                if error:
                    failed = True
                    print(f"{path.name} failed after {seconds:.0f} s.\n{error}", file=sys.stderr, flush=True)
                    continue
                done += 1
                print(f"[{done:2}/{len(paths)}] {path.stem:26} {seconds:4.0f} s", flush=True)
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
            raise
    return not failed


def share_cores(workers: int) -> None:
    """Let each notebook compute and draw on its part of the cores, unless the caller says otherwise."""
    for name in THREADS:
        os.environ.setdefault(name, str(max(1, cores() // max(workers, 1))))


def cores() -> int:
    """Those that this process may use, which in a container are fewer than the machine has."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run(path: Path) -> tuple[float, str]:
    """Run one notebook into its copy; returns the seconds it took, and what went wrong."""
    os.environ.setdefault("JUPYTER_PREFER_ENV_PATH", "1")  # this environment's kernel, not the user's
    notebook, made_of = nbformat.read(path, as_version=4), key(path)
    start = time.perf_counter()
    client = NotebookClient(
        notebook,
        timeout=CELL_TIMEOUT,
        kernel_name="python3",
        record_timing=False,
        coalesce_streams=True,  # how a stream was cut into pieces is chance
        extra_arguments=["--log-level=ERROR"],  # a kernel on the loopback warns that it does not encrypt
        resources={"metadata": {"path": str(path.parent)}},
    )
    try:
        client.execute()
    except (CellExecutionError, DeadKernelError, TimeoutError) as error:  # as text, for not all of them can be pickled
        return time.perf_counter() - start, str(error)
    seconds = time.perf_counter() - start
    tidy(notebook)
    notebook.metadata["gvp"] = {"key": made_of, "seconds": round(seconds, 1)}
    write_whole(notebook, copy_of(path))
    return seconds, ""


def tidy(notebook: NotebookNode) -> None:
    """Drop what means nothing once the kernel has stopped."""
    notebook.metadata.pop("widgets", None)
    notebook.metadata["kernelspec"] = {"display_name": "Python 3", "language": "python", "name": "python3"}
    notebook.metadata["language_info"] = {"name": "python"}
    for cell in code_cells(notebook):
        cell.outputs = [output for output in cell.outputs if WIDGET not in output.get("data", {})]
        for output in cell.outputs:
            if {SCENE_MIME, LAB_MIME} & {*output.get("data", {})}:
                output.data.pop("text/html", None)  # an address on the kernel that has gone


# --- what is up to date -----------------------------------------------------------------------------------------------


def chapters() -> list[Path]:
    """All notebooks, in order."""
    return sorted(NOTEBOOKS.glob("*.ipynb"))


def copy_of(path: Path) -> Path:
    """Where the outputs of a notebook go."""
    return COPIES / path.name


def is_current(path: Path) -> bool:
    """Whether the copy of a notebook was made of what there is now."""
    copy = copy_of(path)
    return copy.exists() and nbformat.read(copy, as_version=4).metadata.get("gvp", {}).get("key") == key(path)


def key(path: Path) -> str:
    """A hash of all that a notebook's outputs depend on."""
    code = [cell.source for cell in code_cells(nbformat.read(path, as_version=4))]
    named = [result for result in sorted(RESULTS.glob("*.json")) if any(result.stem in source for source in code)]
    digest = hashlib.sha256(f"{sys.version} {code!r} {hash_of_library()}".encode())
    for file in (LOCK, *named):
        digest.update(file.read_bytes())
    return digest.hexdigest()


@cache
def hash_of_library() -> str:
    """Of every file of the two packages, models and weights among them."""
    there = chain((ROOT / "gvp_lib").rglob("*"), (ROOT / "book" / "gvp_book").rglob("*"))
    files = (file for file in there if file.is_file() and "__pycache__" not in file.parts)
    parts = [f"{file.relative_to(ROOT)} {hashlib.sha256(file.read_bytes()).hexdigest()}" for file in sorted(files)]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def refresh(path: Path) -> None:
    """Give the copy the notebook's present prose, which changes no output."""
    notebook, copy = nbformat.read(path, as_version=4), nbformat.read(copy_of(path), as_version=4)
    for cell, ran in zip(code_cells(notebook), code_cells(copy), strict=True):
        cell.outputs, cell.execution_count = ran.outputs, ran.execution_count
    notebook.metadata = copy.metadata
    if notebook != copy:
        write_whole(notebook, copy_of(path))


def code_cells(notebook: NotebookNode) -> list[NotebookNode]:
    """The cells that run."""
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def write_whole(notebook: NotebookNode, path: Path) -> None:
    """Write a notebook so that an interrupted call leaves either the old one or the new."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    nbformat.write(notebook, part)
    part.replace(path)


def main() -> int:
    """Run what is not up to date; 1 where a notebook failed, 130 where the call was interrupted."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("notebooks", nargs="*", type=Path, help="default: all")
    parser.add_argument("--workers", type=int, default=cores(), metavar="N", help="how many run at once")
    told = parser.parse_args()
    for gone in {*COPIES.glob("*.ipynb")} - {copy_of(path) for path in chapters()}:
        gone.unlink()
    try:
        return 0 if run_all([path.resolve() for path in told.notebooks] or chapters(), told.workers) else 1
    except KeyboardInterrupt:
        print("interrupted; the same call goes on from here", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
