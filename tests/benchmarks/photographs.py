"""Time and memory of ``gvp photos`` on twelve pictures of twelve megapixels, in a process of its own.

Run as ``python tests/benchmarks/photographs.py``. Aims: a minute on two cores, and 2 GB. The pictures are rendered at a
telephone's size, 4000 x 3000, and written as JPEG; that is not timed. Beside it stands how long OpenCV takes to read
the same files, so that a slow machine shows.
"""

from __future__ import annotations

import os

os.environ["LP_NUM_THREADS"] = "1"  # of software rendering; before anything draws
import gvp_lib.simulation  # noqa: F401 - before mujoco, which then chooses how it draws

# isort: split
import multiprocessing
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
from harness import verdict

from gvp_book.experiments import photographed

COUNT, SIZE = 12, (4000, 3000)


def render(folder: Path) -> None:
    """Write the pictures, in a process whose memory is not what is measured."""
    for k, picture in enumerate(photographed("tea", seed=1, count=COUNT, size=SIZE).pictures):
        cv2.imwrite(str(folder / f"{k:02d}.jpg"), cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))


def main() -> None:
    """Render, run, and print."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        artist = multiprocessing.get_context("spawn").Process(target=render, args=(folder,))
        artist.start()
        artist.join()
        start = time.perf_counter()
        for path in folder.glob("*.jpg"):
            cv2.imread(str(path))
        reading = time.perf_counter() - start
        start = time.perf_counter()
        photos = subprocess.Popen([sys.executable, "-m", "gvp_lib", "photos", name])
        _, status, usage = os.wait4(photos.pid, 0)  # a process begins with its parent's peak, which is small here
        photos.returncode, took = os.waitstatus_to_exitcode(status), time.perf_counter() - start
    if status:
        sys.exit(f"gvp photos ended with {photos.returncode}")
    memory = usage.ru_maxrss / 1e6  # GB, of kB
    print(
        f"{COUNT} pictures: {took:.1f} s, {took / reading:.1f} times as long as to read them; {memory:.2f} GB at most"
    )
    verdict("seconds", took, 60)
    verdict("GB", memory, 2)


if __name__ == "__main__":
    main()
