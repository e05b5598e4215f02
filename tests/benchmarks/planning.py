"""A whole plan's time against what no planner can save, its own pictures; and what the silhouette fit adds to it.

Run as ``python tests/benchmarks/planning.py``. Aims: at most 1.5 of rendering and segmenting the plan's frames, and at
most 2 s per plan for the silhouette fit.
"""

from __future__ import annotations

import gvp_lib.simulation  # noqa: F401 - before mujoco, which then chooses how it draws

# isort: split
import platform
from collections.abc import Callable

import mujoco
import numpy as np
from harness import interleave

from gvp_lib.experiments.episodes import Start, draw_start
from gvp_lib.perception.moments import Blob
from gvp_lib.planning.image_moments import ImageMomentPlanner
from gvp_lib.planning.optimum import QuarticFit
from gvp_lib.planning.silhouette import SilhouetteFit
from gvp_lib.simulation.workcell import WorkCell

FRAMES_AIM, FIT_AIM = 1.5, 2.0  # of the frames' own time; s
SEED = 3


class Recorded:
    """A cell's arm that notes where it stood at each picture."""

    def __init__(self, cell: WorkCell) -> None:
        self._arm, self.poses = cell.arm, []
        self._truth = cell.truth

    def capture(self) -> np.ndarray:
        self.poses.append(self._truth.world_from_camera)
        return self._arm.capture()

    def __getattr__(self, name: str) -> object:
        return getattr(self._arm, name)


def begun(target: str) -> tuple[WorkCell, Start]:
    """A Baxter's cell at the start of an episode."""
    cell = WorkCell("baxter", target, seed=SEED)
    return cell, draw_start(cell, np.random.default_rng(SEED))


def replay(cell: WorkCell, start: Start, planner: ImageMomentPlanner) -> Callable[[], None]:
    """Rendering and segmenting the frames of a plan, the arm put at once where it took them."""
    again(cell, start)
    recorded = Recorded(cell)
    planner.plan(recorded)  # type: ignore[arg-type]
    joints = []
    for pose in recorded.poses:
        cell.place_camera(pose)
        joints.append(cell.arm.joints)
    drive = cell._assembly.holder.drive

    def frames() -> None:
        for q in joints:
            drive.put(q)
            Blob.from_mask(cell.segmenter(cell.arm.capture()))

    return frames


def again(cell: WorkCell, start: Start) -> None:
    """Back to the start of the episode."""
    cell.reset()
    cell.place_camera(start.world_from_camera)


def plans(target: str) -> None:
    """Whole plans from one start."""
    cell, start = begun(target)
    quartic = ImageMomentPlanner(cell.segmenter, QuarticFit())
    silhouette = ImageMomentPlanner(cell.segmenter, SilhouetteFit())
    early = ImageMomentPlanner(cell.segmenter, SilhouetteFit(), until=np.radians(1.2))
    frames = replay(cell, start, quartic)

    def planned(planner: ImageMomentPlanner) -> Callable[[], object]:
        def run() -> object:
            again(cell, start)
            return planner.plan(cell.arm)

        return run

    again(cell, start)
    plan = silhouette.plan(cell.arm)
    views = [list(plan.views[: len(plan.arcs[0])]), list(plan.views)]
    fit, lens = SilhouetteFit(), cell.arm.intrinsics
    print(f"{target}: {plan.frames} pictures, {len(plan.views)} views")
    results = interleave(
        {
            "its pictures, drawn and segmented": frames,
            "plan, quartic": planned(quartic),
            "plan, silhouette": planned(silhouette),
            "plan, silhouette, until certain": planned(early),
            "silhouette fit alone, both arcs": lambda: [fit.fit(some, lens, views[0][0]) for some in views],
        },
        rounds=6,
        calls=1,
    )
    ratio, seconds = results["plan, quartic"].ratio, results["silhouette fit alone, both arcs"].median
    added = results["silhouette fit alone, both arcs"].median / results["plan, quartic"].median
    print(
        f"quartic's plan / its pictures: {ratio:.2f}{'' if ratio <= FRAMES_AIM else f', above the aim of {FRAMES_AIM}'}"
    )
    print(
        f"silhouette fit: {seconds:.2f} s per plan{'' if seconds <= FIT_AIM else f', above the aim of {FIT_AIM} s'}, "
        f"{added:.2f} of the quartic's plan\n"
    )
    cell.close()


def main() -> None:
    """Print the tables."""
    print(f"MuJoCo {mujoco.__version__}, Python {platform.python_version()}, {platform.machine()}\n")
    for target in ("cuboid_1x2", "cylinder"):
        plans(target)


if __name__ == "__main__":
    main()
