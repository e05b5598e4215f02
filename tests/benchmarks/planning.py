"""A whole plan's time against what no planner can save, its own pictures; and the share of it that a fit takes.

Run as ``python tests/benchmarks/planning.py``. Aims, on a Baxter under the thesis's noise: at most 1.5 of rendering and
segmenting the plan's pictures before any fit, and a silhouette fit of at most 0.15 of the plan. With ``--against
CHECKOUT`` it times plans of another checkout's library, such as an older version's, beside this one's.
"""

from __future__ import annotations

import gvp_lib.simulation  # noqa: F401 - before mujoco, which then chooses how it draws

# isort: split
import itertools
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import mujoco
import numpy as np
from harness import command, interleave, record
from scipy.spatial.transform import RigidTransform

from gvp_lib import (
    Blob,
    ImageMomentPlanner,
    Noise,
    Plan,
    QuarticFit,
    SilhouetteFit,
    VirtualSphere,
    WorkCell,
)
from gvp_lib.errors import UnreachableError

FRAMES_AIM, FIT_AIM = 1.5, 0.15  # of the pictures' own time; of the plan
SEEDS = range(6)
TARGETS = ("cuboid_1x2", "cylinder")


class Recorded:
    """A cell's arm that notes where its joints truly are at each picture."""

    def __init__(self, cell: WorkCell) -> None:
        self._arm, self._drive, self.joints_of_pictures = cell.arm, cell._drive, []

    def capture(self) -> np.ndarray:
        self.joints_of_pictures.append(self._drive.joints())
        return self._arm.capture()

    def __getattr__(self, name: str) -> object:
        return getattr(self._arm, name)


class Timed:
    """An estimator that adds up the time it takes."""

    def __init__(self, estimator: SilhouetteFit) -> None:
        self._estimator, self.seconds = estimator, 0.0

    def estimate(self, *given: object) -> object:
        start = time.perf_counter()
        try:
            return self._estimator.estimate(*given)  # type: ignore[arg-type]
        finally:
            self.seconds += time.perf_counter() - start


@dataclass(frozen=True)
class Start:
    """Where an episode begins."""

    seed: int
    world_from_camera: RigidTransform

    @classmethod
    def drawn(cls, cell: WorkCell, seed: int) -> Start:
        """15 to 30 deg off the object's normal, 0.3 m away: the first within the arm's reach."""
        cell.reset(seed)
        rng = np.random.default_rng(seed)
        sphere = VirtualSphere(cell.truth.world_from_object.translation, 0.3)
        while True:
            view = sphere.viewpoint(np.radians(rng.uniform(15, 30)), *rng.uniform(0, 2 * np.pi, 2))
            try:
                cell.place_camera(view)
            except UnreachableError:
                continue
            return cls(seed, view)

    def plan(self, cell: WorkCell, planner: ImageMomentPlanner, arm: Any = None) -> Plan:
        """An episode from here."""
        cell.reset(self.seed)
        cell.place_camera(self.world_from_camera)
        return planner.plan(arm or cell.arm)


def replay(cell: WorkCell, start: Start, planner: ImageMomentPlanner) -> Callable[[], None]:
    """Rendering and segmenting the pictures of a plan, the arm put at once where it took them."""
    recorded, drive = Recorded(cell), cell._drive
    start.plan(cell, planner, recorded)

    def frames() -> None:
        for q in recorded.joints_of_pictures:
            drive.put(q)
            Blob.from_mask(cell.segmenter(cell.arm.capture()))

    return frames


def plans(target: str) -> None:
    """Whole plans from one start."""
    cell = WorkCell("baxter", target, noise=Noise.thesis())
    fit = Timed(SilhouetteFit())
    planners = {
        "plan, quartic": ImageMomentPlanner(cell.segmenter, QuarticFit()),
        "plan, silhouette": ImageMomentPlanner(cell.segmenter, fit),
        "plan, silhouette, until certain": ImageMomentPlanner(cell.segmenter, SilhouetteFit(), until=np.radians(1.2)),
    }
    pictures = "its pictures, drawn and segmented"
    start, rounds = Start.drawn(cell, SEEDS[0]), 6
    rivals: dict[str, Callable[[], object]] = {pictures: replay(cell, start, planners["plan, quartic"])}
    rivals |= {name: partial(start.plan, cell, planner) for name, planner in planners.items()}
    print(f"{target}: {start.plan(cell, planners['plan, quartic']).frames} pictures")
    results = interleave(rivals, rounds, calls=1)
    ratio = results["plan, quartic"].ratio
    share = fit.seconds / (rounds + 1) / results["plan, silhouette"].median
    print(
        f"quartic's plan / its pictures: {ratio:.2f}{'' if ratio <= FRAMES_AIM else f', above the aim of {FRAMES_AIM}'}"
    )
    record(f"the fit's share of such a plan, {target}", ratio=share)
    print(f"silhouette fit / its plan: {share:.2f}{'' if share <= FIT_AIM else f', above the aim of {FIT_AIM}'}\n")
    cell.close()


def from_each_start(target: str, estimator: type[QuarticFit] | type[SilhouetteFit]) -> Callable[[], object]:
    """A Baxter's plan under the thesis's noise, from one start after another."""
    cell = WorkCell("baxter", target, noise=Noise.thesis())
    starts = itertools.cycle([Start.drawn(cell, seed) for seed in SEEDS])
    planner = ImageMomentPlanner(cell.segmenter, estimator())
    return lambda: next(starts).plan(cell, planner)


CASES = {
    f"plan, {name}, {target}": partial(from_each_start, target, estimator)
    for target in TARGETS
    for name, estimator in (("quartic", QuarticFit), ("silhouette", SilhouetteFit))
}


def main() -> None:
    """Print the tables."""
    print(f"MuJoCo {mujoco.__version__}, Python {platform.python_version()}, {platform.machine()}\n")
    for target in TARGETS:
        plans(target)


if __name__ == "__main__":
    command(main, CASES)
