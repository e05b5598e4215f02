"""The thesis's tables and figures, by name: ``gvp reproduce NAME`` computes one and stores it for the book."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gvp_book.experiments import alignment, grasping, learned_tables, reach
from gvp_book.experiments.alignment_report import report
from gvp_book.experiments.grasping_report import grasping_report
from gvp_book.experiments.networks import gpu_at_hand
from gvp_book.running import Settings, run_episodes, store
from gvp_lib.errors import InvalidParameterError, UnknownNameError
from gvp_lib.simulation.sensors import Noise

__all__ = ["TABLES", "Settings", "reproduce"]

Row = dict[str, Any]


def reproduce(name: str, settings: Settings) -> Path:
    """Compute a table or figure of the thesis and store it; a run that was interrupted goes on where it was.

    Returns
    -------
    The file written.

    Raises
    ------
    UnknownNameError
        There is no such table.
    InvalidParameterError
        ResNet-50 is asked for where there is no GPU, or of a table that has no place for it.
    GvpError
        Some episodes failed, which is a defect of the program; those that did not are kept in the journal.
    """
    if name not in TABLES:
        raise UnknownNameError("table or figure", name, TABLES)
    if settings.resnet50:
        _check_resnet50(name)
    return TABLES[name](name, settings)


def _check_resnet50(name: str) -> None:
    if name not in learned_tables.WITH_RESNET50:
        known = ", ".join(learned_tables.WITH_RESNET50)
        raise InvalidParameterError(f"ResNet-50 is for {known}; {name} is the same without --resnet50")
    if not gpu_at_hand():
        raise InvalidParameterError(
            "ResNet-50 is trained on a GPU, and none is at hand here. Without --resnet50 the small networks are "
            "trained, on a processor too"
        )


def _table_3_1(name: str, settings: Settings) -> Path:
    starts = settings.starts or 100
    jobs = alignment_jobs(settings.seed, starts)
    errors: list[float] = []

    def tell(row: Row) -> str | None:
        if "silhouette" in row:
            errors.append(row["silhouette"]["total"])
        return f"silhouette fit: median {np.median(errors):.2f} deg" if errors else None

    rows = _run(name, alignment.align_once, jobs, settings, tell)
    return store(name, settings, starts, report(rows))


def _table_3_2(name: str, settings: Settings) -> Path:
    starts = settings.starts or GRASP_STARTS
    tried: dict[str, list[bool]] = {"thesis": [], "ours": []}

    def tell(row: Row) -> str:
        for method, successes in tried.items():
            if method in row:
                successes.append(row[method]["success"])
        return ", ".join(f"{method} {np.mean(s):.0%}" for method, s in tried.items() if s)

    rows = _run(name, grasping.grasp_once, grasping_jobs(settings.seed, starts), settings, tell)
    return store(name, settings, starts, grasping_report(rows))


def grasping_jobs(seed: int, starts: int) -> dict[str, Row]:
    """Every episode of Table 3.2 under keys ``group/target/placement/k``.

    The thesis's planner and ours run from every start (``thesis``); what they are compared with (``baselines``), both
    of them without noise (``none``) and each with half of the other (``mixed``) from the first ones.
    """
    jobs: dict[str, Row] = {}
    for group, block in _in_blocks(starts):
        for target, placement in grasping.CASES:
            for k in block:
                noise = Noise.none() if group == "none" else Noise.thesis()
                jobs[f"{group}/{target}/{placement}/{k}"] = {
                    "target": target, "placement": placement, "noise": noise_fields(noise),
                    "seed": seed, "k": k, "methods": GROUPS[group],
                }  # fmt: skip
    return jobs


def _reach(name: str, settings: Settings) -> Path:
    starts = settings.starts or REACH_STARTS
    rows = _run(name, reach.reach_once, reach.reach_jobs(settings.seed, starts), settings, lambda row: None)
    return store(name, settings, starts, reach.reach_report(rows))


def _in_blocks(starts: int) -> list[tuple[str, range]]:
    """Which starts of which group run one after the other: so that what a short run has is of every kind."""
    compared, mixed, half = starts // 4, starts // 8, starts // 2
    return [
        ("thesis", range(half)),
        ("baselines", range(compared)),
        ("none", range(compared)),
        ("mixed", range(mixed)),
        *(("thesis", range(k, min(k + _BLOCK, starts))) for k in range(half, starts, _BLOCK)),
    ]


GRASP_STARTS, REACH_STARTS, _BLOCK = 200, 40, 8
GROUPS: Mapping[str, list[str]] = {
    "thesis": ["thesis", "ours"],
    "none": ["thesis", "ours", "oracle"],
    "baselines": ["look_down", "stay", "random", "oracle"],
    "mixed": ["fit, threshold", "quartic, sized"],
}
"""Methods of the groups of Table 3.2; all but ``none`` under the thesis's noise."""


def alignment_jobs(seed: int, starts: int) -> dict[str, Row]:
    """Every episode of Table 3.1, the sweeps last, under keys ``group/target/placement/k``."""
    noises = {"thesis": noise_fields(Noise.thesis()), "none": {}}
    jobs: dict[str, Row] = {}
    for group, noise in noises.items():
        for target, placement in alignment.CASES:
            for k in range(starts):
                methods = [m for m in alignment.METHODS if m != "early" or _stops_early(group, target, k)]
                jobs[f"{group}/{target}/{placement}/{k}"] = {
                    "target": target, "placement": placement, "noise": noise, "seed": seed, "k": k, "methods": methods,
                }  # fmt: skip
    for sweep, (options, cases) in SWEEPS.items():
        for target, placement in cases:
            for k in range(min(starts, SWEEP_STARTS)):
                job = {"target": target, "placement": placement, "noise": noises["thesis"], "seed": seed, "k": k}
                jobs[f"{sweep}/{target}/{placement}/{k}"] = {**job, "methods": ["quartic", "silhouette"], **options}
    return jobs


def _stops_early(group: str, target: str, k: int) -> bool:
    """Which episodes the planner that stops when certain runs too: it sees no end of an alligator."""
    return group == "thesis" and target != "alligator" and k < EARLY_STARTS


def noise_fields(noise: Noise, **changed: float) -> dict[str, float]:
    """A noise as JSON data, with some fields changed."""
    fields = {name: float(getattr(noise, name)) for name in Noise.__dataclass_fields__}
    return {name: value for name, value in {**fields, **changed}.items() if value}


EARLY_STARTS, SWEEP_STARTS = 20, 12
_BRICKS_AND_CAN = tuple((target, "flat") for target in ("cuboid_1x1", "cuboid_1x2", "cuboid_1x4", "cylinder"))
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


def _run(
    name: str,
    function: Callable[[Mapping[str, Any]], Row],
    jobs: Mapping[str, Row],
    settings: Settings,
    tell: Callable[[Row], str | None],
) -> dict[str, Row]:
    return run_episodes(name, function, jobs, settings, recipe=_recipe(name, settings), tell=tell)


def _recipe(name: str, settings: Settings) -> Row:
    """What the episodes of a table depend on; not on how many there are, so that a run may go on with more of them."""
    jobs = json.dumps(_JOBS[name](settings.seed, _ALL_KINDS)).encode()
    return {"seed": settings.seed, "jobs": hashlib.sha256(jobs).hexdigest()}


TABLES: Mapping[str, Callable[[str, Settings], Path]] = {
    "table-3.1": _table_3_1,
    "table-3.2": _table_3_2,
    **learned_tables.TABLES,
    "reach": _reach,
}
"""What can be reproduced, by name."""

_JOBS: Mapping[str, Callable[[int, int], dict[str, Row]]] = {
    "table-3.1": alignment_jobs,
    "table-3.2": grasping_jobs,
    "reach": reach.reach_jobs,
}
_ALL_KINDS = 100  # starts, among which are jobs of every kind
