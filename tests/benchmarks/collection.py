"""What a set of viewpoints costs against its bare pictures, in time and in memory.

Run as ``python tests/benchmarks/collection.py``; some five minutes. Aims: 4096 viewpoints by the UR5e in at most 60 s
on two quiet cores, and at most 1.5 times as long as rendering as many pictures as were taken; at most 3 pictures a
sample; a peak of memory that is the same at 20 000 samples.
"""

from __future__ import annotations

import os

os.environ["LP_NUM_THREADS"] = "1"  # of software rendering; before anything draws
import gvp_lib.simulation  # noqa: F401 - before mujoco, which then chooses how it draws

# isort: split
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from harness import command, verdict

from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.jobs import run_jobs
from gvp_lib.learning.collect import collect_dataset
from gvp_lib.learning.recipe import CollectionRecipe
from gvp_lib.simulation.workcell import WorkCell

RATIO_AIM, SECONDS_AIM, FRAMES_AIM, MEMORY_AIM = 1.5, 60.0, 3.0, 1.1
WORKERS, ROUNDS = 2, 3


def render(job: dict[str, Any]) -> int:
    """Bare pictures from a viewpoint above the object, with nothing done to them."""
    global _cell
    if _cell is None:
        _cell = WorkCell("ur5e", seed=0)
        center = _cell.truth.world_from_object.translation
        _cell.place_camera(VirtualSphere(center, CollectionRecipe.radius).viewpoint(0.2, 3.0))
    return sum(len(_cell.arm.capture()) > 0 for _ in range(job["frames"]))


_cell: WorkCell | None = None


def against_bare_pictures(folder: Path) -> None:
    """As many pictures of either kind, in turns, each by a pool of its own whose start is part of it."""
    ratios = []
    for k in range(ROUNDS):
        recipe = CollectionRecipe(n=1024, seed=k, sampling="random" if k % 2 else "uniform")
        began = time.perf_counter()
        counts = collect_dataset(folder / f"ratio-{k}", recipe, workers=WORKERS, progress=False).card["counts"]
        seconds = time.perf_counter() - began
        frames, shards = counts["frames"], recipe.n // recipe.shard
        share = [frames // shards + (i < frames % shards) for i in range(shards)]
        began = time.perf_counter()
        run_jobs(render, {str(i): {"frames": share[i]} for i in range(shards)}, workers=WORKERS, progress=False)
        ratios.append(seconds / (time.perf_counter() - began))
        print(f"{recipe.sampling:8s}{frames} frames, {counts['replaced']} replaced: {ratios[-1]:.2f}")
        assert frames <= FRAMES_AIM * recipe.n
    verdict("against bare pictures", statistics.median(ratios), RATIO_AIM)


def time_and_memory(folder: Path) -> None:
    """The thesis's number of samples, and five times as many; peaks of the parent and of its largest worker."""
    peaks = {}
    for n in (4096, 20000):
        collect = [sys.executable, "-c", _PEAK, "collect", folder / f"n-{n}", "--quiet", "--n", n, "--workers", WORKERS]
        began = time.perf_counter()
        printed = subprocess.run([*map(str, collect)], check=True, capture_output=True, text=True).stdout
        seconds = time.perf_counter() - began
        peaks[n] = [int(kib) for kib in printed.split()[-2:]]
        parent, worker = (peak / 1024 for peak in peaks[n])
        print(f"{n} samples: {seconds:.0f} s; peaks {parent:.0f} MiB in the parent, {worker:.0f} in a worker")
        if n == 4096:
            verdict("seconds", seconds, SECONDS_AIM)
    growth = max(large / small for small, large in zip(peaks[4096], peaks[20000], strict=True))
    verdict("memory at 20 000 samples against 4096", growth, MEMORY_AIM)


# Runs ``gvp`` in this very process, then prints its peak and that of its largest child, KiB.
_PEAK = """
import resource, sys
from gvp_lib.cli import main
status = main(sys.argv[1:])
print(*(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)))
sys.exit(status)
"""


def main() -> None:
    """Print the figures."""
    with tempfile.TemporaryDirectory() as scratch:
        against_bare_pictures(Path(scratch))
        time_and_memory(Path(scratch))


if __name__ == "__main__":
    command(main, {})
