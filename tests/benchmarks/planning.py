"""A whole plan's time against what none can save, its own pictures; a fit's share of a plan; and what a second process
gains over a dozen episodes.

Run as ``python tests/benchmarks/planning.py``. Aims, on a Baxter under the thesis's noise: at most 1.5 of rendering and
segmenting the plan's pictures before any fit, and a silhouette fit of at most 0.15 of the plan; two processes, one
rendering thread each, 1.6 times as fast as one, with the same results to the bit. With ``--against CHECKOUT`` it times
plans of another checkout's library, such as an older version's, beside this one's.
"""

from __future__ import annotations

import os

os.environ["LP_NUM_THREADS"] = "1"  # of software rendering; before anything draws
import gvp_lib.simulation  # before mujoco, which then chooses how it draws

# isort: split
import itertools
import time
from collections.abc import Callable, Sequence
from functools import partial
from unittest.mock import patch

import numpy as np
from harness import command, interleave, record, verdict

from gvp_lib import Blob, ImageMomentPlanner, Noise, QuarticFit, SilhouetteFit, VirtualSphere, WorkCell
from gvp_lib.errors import UnreachableError
from gvp_lib.motion.sighting import Eye

FRAMES_AIM, FIT_AIM, SPEEDUP_AIM = 1.5, 0.15, 1.6  # of the pictures' own time; of the plan; by a second process
SEEDS, SEED = range(6), 3
TARGETS = ("cuboid_1x2", "cylinder")


class Timed(SilhouetteFit):
    """An estimator that adds up the time it takes."""

    seconds = 0.0

    def estimate(self, *given: object) -> object:
        start = time.perf_counter()
        fit = super().estimate(*given)  # type: ignore[arg-type]
        object.__setattr__(self, "seconds", self.seconds + time.perf_counter() - start)
        return fit


def draw(cell: WorkCell, joints: Sequence[np.ndarray]) -> None:
    """Render and segment pictures, the arm put at once where it took them."""
    for q in joints:
        cell._drive.put(q)
        Blob.from_mask(cell.segmenter(cell.arm.capture()))


def start_of(cell: WorkCell, seed: int) -> Callable[[], None]:
    """Goes to where an episode begins: 15 to 30 deg off the object's normal, 0.3 m away, within the arm's reach."""
    cell.reset(seed)
    rng = np.random.default_rng(seed)
    sphere = VirtualSphere(cell.truth.world_from_object.translation, 0.3)
    while True:
        view = sphere.viewpoint(np.radians(rng.uniform(15, 30)), *rng.uniform(0, 2 * np.pi, 2))
        try:
            cell.place_camera(view)
        except UnreachableError:
            continue
        return lambda: (cell.reset(seed), cell.place_camera(view))[1]


def plans(target: str) -> None:
    """Whole plans from one start."""
    cell, fit, rounds = WorkCell("baxter", target, noise=Noise.thesis()), Timed(), 6
    planners = {
        "plan, quartic": ImageMomentPlanner(cell.segmenter, QuarticFit()),
        "plan, silhouette": ImageMomentPlanner(cell.segmenter, fit),
        "plan, silhouette, until certain": ImageMomentPlanner(cell.segmenter, SilhouetteFit(), until=np.radians(1.2)),
    }
    begin = start_of(cell, SEEDS[0])

    def plan(planner: ImageMomentPlanner) -> None:
        begin()
        planner.plan(cell.arm)

    joints, capture = [], cell.arm.capture
    with patch.object(cell.arm, "capture", lambda: (joints.append(cell._drive.joints()), capture())[1]):
        plan(planners["plan, quartic"])
    print(f"{target}: {len(joints)} pictures")
    rivals: dict[str, Callable[[], object]] = {"its pictures, drawn and segmented": partial(draw, cell, joints)}
    results = interleave(rivals | {name: partial(plan, planner) for name, planner in planners.items()}, rounds, calls=1)
    share = fit.seconds / (rounds + 1) / results["plan, silhouette"].median
    record(f"the fit's share of such a plan, {target}", ratio=share)
    verdict("quartic's plan / its pictures", results["plan, quartic"].ratio, FRAMES_AIM)
    verdict("silhouette fit / its plan", share, FIT_AIM)
    cell.close()


def processes() -> None:
    """A dozen episodes under the thesis's noise, three to a case, by one process and by two; their start is in it."""
    from gvp_book.experiments.grasping import CASES, grasp_once
    from gvp_book.results import noise_fields
    from gvp_lib.jobs import run_jobs

    jobs = {
        f"{target}/{k}": {
            "target": target, "placement": "flat", "k": k, "noise": noise_fields(Noise.thesis()), "seed": SEED,
            "methods": ["stay", "oracle"],
        }
        for target in [target for target, placement in CASES if placement == "flat"][:4]
        for k in range(3)
    }  # fmt: skip
    seconds, results = {}, {}
    for workers in (1, 2):
        began = time.perf_counter()
        results[workers] = run_jobs(grasp_once, jobs, workers=workers, progress=False)
        seconds[workers] = time.perf_counter() - began
    failed = [result.error for result in results[1].values() if result.failed]
    assert not failed, failed[0]
    assert results[1] == results[2], "two processes told something else than one"
    print(f"{len(jobs)} episodes: {seconds[1]:.1f} s by one process, {seconds[2]:.1f} s by two, the same to the bit")
    verdict("speed-up", seconds[1] / seconds[2], SPEEDUP_AIM, least=True)


def from_each_start(target: str, estimator: type[QuarticFit] | type[SilhouetteFit]) -> Callable[[], object]:
    """A Baxter's plan under the thesis's noise, from one start after another."""
    cell = WorkCell("baxter", target, noise=Noise.thesis())
    starts = itertools.cycle([start_of(cell, seed) for seed in SEEDS])
    planner = ImageMomentPlanner(cell.segmenter, estimator())
    return lambda: (next(starts)(), planner.plan(cell.arm))


def best_from_each_start(target: str) -> Callable[[], object]:
    """The same by the best planner of each version: views from all around, where 0.1 has but arcs."""
    cell = WorkCell("baxter", target, noise=Noise.thesis())
    starts = itertools.cycle([start_of(cell, seed) for seed in SEEDS])
    if hasattr(gvp_lib, "SpreadViews"):
        planner = gvp_lib.SpreadViews(cell.segmenter)
    else:
        planner = ImageMomentPlanner(cell.segmenter, SilhouetteFit())
    return lambda: (next(starts)(), planner.plan(cell.arm))


def of_eight_views(target: str, warm: bool) -> Callable[[], object]:
    """A fit to eight views from all around by the best estimator of each version; or a warm one, which begins at the
    solid of the first seven, as none of 0.1 can."""
    cell = WorkCell("floating", target, noise=Noise.thesis(), seed=SEED)
    eye, views = Eye(cell.arm, cell.segmenter), []
    for pose in VirtualSphere(cell.truth.world_from_object.translation, 0.3).uniform(8, np.radians(50)):
        cell.place_camera(pose)
        views.append(eye.look())
    lens, fit = cell.arm.intrinsics, getattr(gvp_lib, "ContourFit", SilhouetteFit)().fit
    start = {"start": fit(views[:-1], lens)} if warm and hasattr(gvp_lib, "ContourFit") else {}
    return lambda: fit(views, lens, **start)


CASES = {
    f"plan, {name}, {target}": partial(from_each_start, target, estimator)
    for target in TARGETS
    for name, estimator in (("quartic", QuarticFit), ("silhouette", SilhouetteFit))
}
for _target in TARGETS:
    CASES[f"plan, ours, {_target}"] = partial(best_from_each_start, _target)
    CASES[f"fit of eight views, {_target}"] = partial(of_eight_views, _target, warm=False)
    CASES[f"warm fit of eight views, {_target}"] = partial(of_eight_views, _target, warm=True)


def main() -> None:
    """Print the tables."""
    for target in TARGETS:
        plans(target)
    processes()


if __name__ == "__main__":
    command(main, CASES)
