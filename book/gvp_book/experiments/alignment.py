"""The experiment behind Table 3.1: how well the image-moment planner aligns, and how well it could. Thesis 3.1.6.

Each episode draws one start. From it the thesis's planner runs; then our estimator concludes from the very views that
it took; then, from the same start again, our planner that stops when it is certain, and the baselines.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from gvp_lib.evaluation import baselines
from gvp_lib.evaluation.episodes import begin, begin_again, cell_of, judge, run_episode
from gvp_lib.evaluation.metrics import face_corners, homography_error
from gvp_lib.planning.image_moments import ImageMomentPlanner, QuarticFit
from gvp_lib.planning.plan import MIN_VIEWS, Plan
from gvp_lib.planning.silhouette import SilhouetteFit
from gvp_lib.simulation.objects import BODY_HEIGHT, PITCH
from gvp_lib.simulation.workcell import WorkCell

__all__ = ["CASES", "METHODS", "SIZES", "align_once"]

CASES: tuple[tuple[str, str], ...] = (
    *(("cuboid_1x1", placement) for placement in ("flat", "raised", "side", "tilted")),
    *(("cuboid_1x2", placement) for placement in ("flat", "raised", "tilted")),
    *(("cuboid_1x4", placement) for placement in ("flat", "raised", "tilted")),
    *(("cylinder", placement) for placement in ("flat", "raised", "side", "tilted")),
    *(("alligator", placement) for placement in ("flat", "raised", "tilted")),
)
"""Objects and placements; all but ``tilted`` are the thesis's (Fig. 3.1)."""

METHODS = ("quartic", "silhouette", "early", "stay", "look_down", "oracle")
"""The thesis's planner; ours on the same views; ours that stops when certain; the baselines."""

UNTIL = float(np.radians(1.5))  # rad, of the planner that stops when certain

SIZES: Mapping[str, tuple[float, float, float]] = {
    **{f"cuboid_1x{n}": (n * PITCH, PITCH, BODY_HEIGHT) for n in (1, 2, 4)},
    "cylinder": (0.060, 0.060, 0.150),
}
"""True lengths, m: a brick's body without studs; a can with its cap."""


def align_once(job: Mapping[str, Any]) -> dict[str, Any]:
    """One episode: a start, and what each method makes of it.

    Parameters
    ----------
    job
        JSON data: ``target``, ``placement``, ``noise`` (fields of :class:`Noise`), ``seed``, ``k`` (the number of the
        start), ``methods``; optionally ``planner`` and ``quartic`` (fields of :class:`ImageMomentPlanner` and
        :class:`QuarticFit`) and ``cell`` (arguments of :class:`WorkCell`).

    Returns
    -------
    dict
        ``start`` and, for each method, a judgement (angles in deg), with what else is known of it.
    """
    cell = cell_of(job)
    start = begin(cell, job)
    row: dict[str, Any] = {
        "start": {"tilt": float(np.degrees(start.tilt)), "distance": start.distance, "tries": start.tries}
    }
    options = dict(job.get("planner", {}))
    quartic = ImageMomentPlanner(cell.segmenter, QuarticFit(**job.get("quartic", {})), **options)
    fit = SilhouetteFit()
    silhouette = ImageMomentPlanner(cell.segmenter, fit, **options)
    noisy = np.random.default_rng([job["seed"], job["k"]])  # of the corners
    methods = job["methods"]
    if "quartic" in methods or "silhouette" in methods:
        plan, judged = run_episode(cell, lambda cell: quartic.plan(cell.arm))
        row["quartic"] = judged.to_dict() | {"homography": _homography(cell, noisy)} | _first_arc(cell, plan)
        if "silhouette" in methods and len(plan.views) >= MIN_VIEWS:
            began = cell.time
            concluded = silhouette.conclude(cell.arm, plan.arcs)
            found = judge(cell, concluded, cell.time - began).to_dict()
            row["silhouette"] = found | {"homography": _homography(cell, noisy)} | _solid(job["target"], concluded)
        elif "silhouette" in methods:
            row["silhouette"] = judged.to_dict()  # nothing to conclude from: the camera stays where that plan ended
    others: dict[str, Callable[[WorkCell], Plan]] = {
        "full": lambda cell: silhouette.plan(cell.arm),
        "early": lambda cell: ImageMomentPlanner(cell.segmenter, fit, until=UNTIL, **options).plan(cell.arm),
        **{name: getattr(baselines, name) for name in ("stay", "look_down", "oracle")},
    }
    for name in (name for name in methods if name in others):
        begin_again(cell, start)
        plan, judged = run_episode(cell, others[name])
        row[name] = judged.to_dict() | (_solid(job["target"], plan) if name in ("full", "early") else {})
    return row


def _homography(cell: WorkCell, rng: np.random.Generator) -> float | None:
    """The thesis's metric at the camera's true pose, deg; None for an object without four corners."""
    if cell.target_spec.name not in SIZES:
        return None
    camera = cell.truth.world_from_camera
    facing = cell.truth.normal.nearest(-camera.rotation.as_matrix()[:, 2])
    corners = face_corners(cell.target_spec, cell.truth.world_from_object, facing)
    return float(np.degrees(homography_error(corners, camera, cell.arm.intrinsics, rng).total))


def _first_arc(cell: WorkCell, plan: Plan) -> dict[str, Any]:
    """Error left along the first arc where the second began, deg, as the arm believes."""
    if len(plan.arcs) < 2:
        return {}
    second = plan.arcs[1]
    view = second.views[second.center].base_from_camera.rotation.as_matrix()
    across = 1 if plan.arcs[0].axis == "y" else 0
    normal = view.T @ cell.truth.normal.nearest(-view[:, 2])
    return {"first_arc": float(np.degrees(np.arctan2(normal[across], -normal[2])))}


def _solid(target: str, plan: Plan) -> dict[str, Any]:
    """What the fit says of the object, and how far its sizes are off, mm."""
    solid = plan.solid
    if solid is None:
        return {}
    told: dict[str, Any] = {"kind": solid.kind, "uncertainty": float(np.degrees(solid.uncertainty))}
    if target in SIZES:
        lengths = solid.sizes + ((0.0, 0.0, solid.top[1]) if solid.kind == "cylinder" else (0.0, 0.0, 0.0))
        off = np.sort(lengths) - np.sort(SIZES[target])
        told["size_error_mm"] = float(1000 * np.abs(off).max())
    return told
