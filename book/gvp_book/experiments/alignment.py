"""The experiment behind Table 3.1: how well the image-moment planner aligns, and how well it could. Thesis 3.1.6.

Each episode draws one start. First the thesis's planner runs; then our estimator is applied to the same views; then,
from the same start again, our planner runs, which stops once it is certain, and the baselines.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from gvp_book.results import Experiment, Row, by_case, noise_fields
from gvp_lib.evaluation.baselines import LookDown, Oracle, Stay
from gvp_lib.evaluation.episodes import begin, begin_again, cell_of, judge, run_episode
from gvp_lib.evaluation.metrics import face_corners, homography_error, homography_floor
from gvp_lib.evaluation.statistics import paired_difference, summarize, wilson_interval
from gvp_lib.motion.arm import Outcome
from gvp_lib.planning.image_moments import ImageMomentPlanner, QuarticFit
from gvp_lib.planning.plan import MIN_VIEWS, Plan, ViewpointPlanner
from gvp_lib.planning.silhouette import SilhouetteFit
from gvp_lib.planning.spread import SpreadViews
from gvp_lib.simulation.objects import BODY_HEIGHT, PITCH
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import WorkCell

THESIS: Mapping[str, tuple[float, float]] = {
    "cuboid_1x1": (15.4, 4.6),
    "cuboid_1x2": (12.4, 4.2),
    "cuboid_1x4": (10.5, 6.3),
    "cylinder": (8.2, 2.1),
}
"""Table 3.1 as printed: mean and standard deviation of the angle error, deg."""

CASES: tuple[tuple[str, str], ...] = tuple(
    (target, placement)
    for target, placements in {
        "cuboid_1x1": ("flat", "raised", "side", "tilted"),
        "cuboid_1x2": ("flat", "raised", "tilted"),
        "cuboid_1x4": ("flat", "raised", "tilted"),
        "cylinder": ("flat", "raised", "side", "tilted"),
        "alligator": ("flat", "raised", "tilted"),
    }.items()
    for placement in placements
)
"""Objects and placements; all but ``tilted`` are the thesis's (Fig. 3.1)."""

METHODS = ("quartic", "silhouette", "ours", "stay", "look_down", "oracle")
"""The thesis's planner; the moments' fit on the same views; ours, from a handful of its own; the baselines."""

SIZES: Mapping[str, tuple[float, float, float]] = {
    **{f"cuboid_1x{n}": (n * PITCH, PITCH, BODY_HEIGHT) for n in (1, 2, 4)},
    "cylinder": (0.060, 0.060, 0.150),
}
"""True lengths, m: a brick's body without studs; a can with its cap."""


# --- the episodes -----------------------------------------------------------------------------------------------------


_NOISES = {"thesis": noise_fields(Noise.thesis()), "none": {}}
_SWEEP_STARTS = 12
_BRICKS_AND_CAN = tuple((target, "flat") for target in SIZES)
_ONE = (("cuboid_1x2", "flat"),)


def _with_noise(**changed: float) -> Row:
    return {"noise": noise_fields(Noise.thesis(), **changed)}


SWEEPS: Mapping[str, tuple[Row, Sequence[tuple[str, str]]]] = {
    "step=10mm": ({"planner": {"step": 0.010}}, _BRICKS_AND_CAN),
    "step=40mm": ({"planner": {"step": 0.040}}, _BRICKS_AND_CAN),
    "order=major first": ({"planner": {"order": "major first"}}, _BRICKS_AND_CAN),
    "x=angle, interpolated": ({"quartic": {"x": "angle", "interpolate": True}}, _BRICKS_AND_CAN),
    "own traversal": ({"methods": ["full"]}, _BRICKS_AND_CAN),
    "focal length +-0%": (_with_noise(focal_length=0.0), _ONE),
    "focal length +-5%": (_with_noise(focal_length=0.05), _ONE),
    "focal length +-10%": (_with_noise(focal_length=0.10), _ONE),
    "distortion +-0.1": (_with_noise(distortion=0.1), _ONE),
    "distortion +-0.3": (_with_noise(distortion=0.3), _ONE),
    "walled": ({}, (("cuboid_1x2", "walled"),)),
    "shadows and highlights": ({"cell": {"shadows": True, "highlights": True}}, _ONE),
}
"""What is varied, under the thesis's noise: job options, and the cases it is tried on."""


def alignment_jobs(seed: int, starts: int) -> dict[str, Row]:
    """Jobs of all episodes of Table 3.1, the sweeps last, with keys ``group/target/placement/k``."""
    jobs: dict[str, Row] = {}
    for group, noise in _NOISES.items():
        for target, placement in CASES:
            for k in range(starts):
                jobs[f"{group}/{target}/{placement}/{k}"] = {
                    "target": target, "placement": placement, "noise": noise, "seed": seed, "k": k,
                    "methods": [*METHODS],
                }  # fmt: skip
    for sweep, (options, cases) in SWEEPS.items():
        for target, placement in cases:
            for k in range(min(starts, _SWEEP_STARTS)):
                job = {"target": target, "placement": placement, "noise": _NOISES["thesis"], "seed": seed, "k": k}
                own = [] if {"planner", "quartic"} & set(options) else ["ours"]
                jobs[f"{sweep}/{target}/{placement}/{k}"] = {**job, "methods": [*METHODS[:2], *own], **options}
    return jobs


def align_once(job: Mapping[str, Any]) -> Row:
    """Run one episode: from one start, the judgement of each method (angles in deg), with further details.

    A job has ``target``, ``placement``, ``noise`` (fields of :class:`Noise`), ``seed``, ``k`` (the number of the
    start), ``methods``; optionally ``planner`` and ``quartic`` (fields of :class:`ImageMomentPlanner` and
    :class:`QuarticFit`) and ``cell`` (arguments of :class:`WorkCell`).
    """
    cell = cell_of(job)
    start = begin(cell, job["k"], job["seed"])
    row: Row = {"start": {"tilt": float(np.degrees(start.tilt)), "distance": start.distance, "tries": start.tries}}
    options = job.get("planner", {})
    quartic = ImageMomentPlanner(cell.segmenter, QuarticFit(**job.get("quartic", {})), **options)
    fit = SilhouetteFit()
    silhouette = ImageMomentPlanner(cell.segmenter, fit, **options)
    noisy = np.random.default_rng([job["seed"], job["k"]])  # of the corners
    methods = job["methods"]
    if "quartic" in methods or "silhouette" in methods:
        plan, judged = run_episode(cell, quartic)
        row["quartic"] = judged.to_dict() | {"homography": _homography(cell, noisy)} | _first_arc(cell, plan)
        if "silhouette" in methods and len(plan.views) >= MIN_VIEWS:
            began = cell.time
            concluded = silhouette.conclude(cell.arm, plan.arcs)
            found = judge(cell, concluded, cell.time - began).to_dict()
            row["silhouette"] = found | {"homography": _homography(cell, noisy)} | _solid(job["target"], concluded)
        elif "silhouette" in methods:
            row["silhouette"] = judged.to_dict()  # nothing to conclude from: the camera stays where that plan ended
    others: dict[str, ViewpointPlanner] = {
        "full": silhouette,
        "ours": SpreadViews(cell.segmenter),
        "stay": Stay(cell.segmenter),
        "look_down": LookDown(cell.segmenter),
        "oracle": Oracle(cell),
    }
    for name in (name for name in methods if name in others):
        begin_again(cell, start)
        plan, judged = run_episode(cell, others[name])
        row[name] = judged.to_dict() | (_solid(job["target"], plan) if name in ("full", "ours") else {})
    return row


def _homography(cell: WorkCell, rng: np.random.Generator) -> float | None:
    """The thesis's metric at the camera's true pose, deg; None for an object without four corners."""
    if cell.target_spec.name not in SIZES:
        return None
    camera = cell.truth.world_from_camera
    facing = cell.truth.normal.nearest(-camera.rotation.as_matrix()[:, 2])
    corners = face_corners(cell.target_spec, cell.truth.world_from_object, facing)
    return float(np.degrees(homography_error(corners, camera, cell.arm.intrinsics, rng).total))


def _first_arc(cell: WorkCell, plan: Plan) -> Row:
    """Error left along the first arc where the second began, deg, as the arm believes."""
    if len(plan.arcs) < 2:
        return {}
    first, second = plan.arcs[:2]
    view = second.views[second.center].base_from_camera.rotation.as_matrix()
    normal = view.T @ cell.truth.normal.nearest(-view[:, 2])
    return {"first_arc": float(np.degrees(np.arctan2(normal[int(first.axis == "y")], -normal[2])))}


def _solid(target: str, plan: Plan) -> Row:
    """What the fit says of the object, and how far its sizes are off, mm."""
    solid = plan.solid
    if solid is None:
        return {}
    said: Row = {"kind": solid.kind, "uncertainty": float(np.degrees(solid.uncertainty))}
    if solid.explains:
        said["within_90"] = float(np.degrees(solid.within(0.9)))
    if target in SIZES:
        lengths = solid.sizes + ((0.0, 0.0, solid.top[1]) if solid.kind == "cylinder" else (0.0, 0.0, 0.0))
        off = np.sort(lengths) - np.sort(SIZES[target])
        said["size_error_mm"] = float(1000 * np.abs(off).max())
    return said


# --- what they add up to ----------------------------------------------------------------------------------------------

_KEPT = {
    "quartic": ("first_arc", "homography"),
    "silhouette": ("homography", "size_error_mm", "uncertainty"),
    "ours": ("size_error_mm", "uncertainty"),
}


def report(rows: Mapping[str, Row]) -> Row:
    """Content of the stored result; angles in deg.

    It is made from rows of :func:`align_once` with keys ``group/target/placement/k``, in order of k. ``thesis``: the
    printed table. ``summary``: by group and case, statistics of each method, over all episodes (``error``) and over
    those whose plan arrived (``arrived``); ``in_90``: how often a claimed 90 % region holds the error. ``pooled``: by
    group, over all cases but the alligator. ``sweeps``: the same planner with one thing varied, beside the unchanged
    one on the same starts. ``floors``: what the thesis's metric says of a camera without error. ``rows``: every
    episode's error.
    """
    cases = by_case(rows)
    main = {case: group for case, group in cases.items() if case.partition("/")[0] in _NOISES}
    pooled: dict[str, list[Row]] = {name: [] for name in _NOISES}
    for case, group in main.items():
        name, target, _ = case.split("/")
        pooled[name] += group if target in SIZES else []
    return {
        "thesis": {name: {"mean": mean, "sd": sd} for name, (mean, sd) in THESIS.items()},
        "summary": {case: _summary(group) for case, group in main.items()},
        "pooled": {name: _summary(group) for name, group in pooled.items()},
        "sweeps": {case: _sweep(case, cases) for case in cases if case not in main},
        "floors": _floors(),
        "rows": {case: _columns(group) for case, group in main.items()},
    }


def _summary(group: Sequence[Row]) -> Row:
    methods = [name for name in METHODS if any(name in row for row in group)]
    summary: Row = {method: describe([row[method] for row in group if method in row]) for method in methods}
    for a, b in (("quartic", "silhouette"), ("silhouette", "ours"), ("ours", "oracle")):
        both = [(row[a]["total"], row[b]["total"]) for row in group if a in row and b in row]
        if both:
            summary[f"{a} - {b}"] = paired_difference(*np.transpose(both))
    return summary


def _sweep(case: str, cases: Mapping[str, Sequence[Row]]) -> Row:
    varied, place = cases[case], case.partition("/")[2].replace("walled", "flat")
    unchanged = cases.get(f"thesis/{place}", [])[: len(varied)]

    def each(group: Sequence[Row], *methods: str) -> Row:
        return {name: describe([row[name] for row in group if name in row]) for name in methods}

    methods = ("quartic", "silhouette", "ours")
    sweep = {**each(varied, *methods, "full"), "unchanged": each(unchanged, *methods)}
    return {name: value for name, value in sweep.items() if value}


def describe(judged: Sequence[Row]) -> Row:
    """Compute statistics of one method on one case; angles in deg."""
    if not judged:
        return {}
    summary: Row = {
        "error": summarize([row["total"] for row in judged]),
        "outcomes": dict(Counter(row["outcome"] for row in judged)),
        "arrived": summarize([row["total"] for row in judged if Outcome(row["outcome"]).arrived]),
        **{name: float(np.nanmean(np.abs([row[name] for row in judged]))) for name in ("about_x", "about_y", "roll")},
        **{name: float(np.mean([row[name] for row in judged])) for name in ("views", "frames", "seconds")},
    }
    for name in ("homography", "size_error_mm", "uncertainty"):
        # A corner behind the camera has no pixel, and the metric no value.
        values = [row[name] for row in judged if row.get(name) is not None and np.isfinite(row[name])]
        if values:
            summary[name] = summarize(values)
    claimed = [row["total"] <= row["within_90"] for row in judged if row["outcome"] == "aligned" and "within_90" in row]
    if claimed:
        held = wilson_interval(sum(claimed), len(claimed))
        summary["in_90"] = {"rate": float(np.mean(claimed)), "low": held.low, "high": held.high, "n": len(claimed)}
    return summary


def _columns(group: Sequence[Row]) -> Row:
    """Every episode of a case, column by column and to a hundredth, so that thousands stay a small file."""
    table: Row = {"tilt": [round(row["start"]["tilt"], 2) for row in group]}
    for method in METHODS:
        rows = [row.get(method, {}) for row in group]
        if not any(rows):
            continue
        columns = {
            name: [None if row.get(name) is None else round(row[name], 2) for row in rows]
            for name in ("total", *_KEPT.get(method, ()))
        }
        table[method] = {
            **{name: values for name, values in columns.items() if any(value is not None for value in values)},
            # Only outcomes other than the usual, by the number of the start.
            "outcomes": {str(k): row["outcome"] for k, row in enumerate(rows) if row and row["outcome"] != "aligned"},
        }
    return table


@cache  # it depends on no episode
def _floors() -> Row:
    """What the thesis's metric says of a camera without any error, at 0.25 m from the corners, deg."""
    table: Row = {}
    for target, placement in CASES:
        if target in SIZES and placement in ("flat", "side"):
            with WorkCell("floating", target, placement) as cell:
                corners = face_corners(cell.target_spec, cell.truth.world_from_object, cell.truth.normal.direction)
                floor = homography_floor(corners, 0.25, cell.arm.intrinsics)
            table[f"{target}/{placement}"] = float(np.degrees(floor.mean))
    return table


def _status(rows: Sequence[Row]) -> str:
    errors = [row["ours"]["total"] for row in rows if "ours" in row]
    return f"ours: mean {np.mean(errors):.2f}, median {np.median(errors):.2f} deg" if errors else ""


EXPERIMENT = Experiment(align_once, alignment_jobs, report, starts=100, status=_status)
"""Table 3.1."""
