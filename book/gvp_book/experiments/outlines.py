"""The experiment on what spoils a silhouette: something in the way, the picture's border, a mask that is wrong.

Each episode is one of our planner under the thesis's noise, from the starts of Table 3.1.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gvp_book.results import Experiment, Row, by_case, noise_fields
from gvp_lib.evaluation.episodes import begin, run_episode
from gvp_lib.evaluation.statistics import summarize
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arm import Outcome
from gvp_lib.motion.sighting import View
from gvp_lib.perception.blobs import blobs_from_mask
from gvp_lib.perception.outlines import Outline
from gvp_lib.perception.segmentation import Segmenter
from gvp_lib.planning.contours import ContourFit
from gvp_lib.planning.plan import MIN_VIEWS
from gvp_lib.planning.spread import SpreadViews
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import CellCache, WorkCell

_TARGETS = ("cuboid_1x1", "cuboid_1x2", "cuboid_1x4", "cylinder")
_WALLED = tuple((target, "walled") for target in _TARGETS)
_FLAT = tuple((target, "flat") for target in _TARGETS)

CONDITIONS: Mapping[str, tuple[Row, Sequence[tuple[str, str]]]] = {
    "walled": ({}, _WALLED),
    "walled, patterned table": ({"pattern": True}, _WALLED),
    "neighbor of another color": ({"beside": ["cuboid_1x4"]}, (("cuboid_1x2", "flat"),)),
    "neighbor of the same color": ({"beside": ["cuboid_1x2"]}, (("cuboid_1x2", "flat"),)),
    "every view cut on one side": ({"cut": 1}, _FLAT),
    "every view cut on two sides": ({"cut": 2}, _FLAT),
    "eroded": ({"mask": "eroded"}, _FLAT),
    "dilated": ({"mask": "dilated"}, _FLAT),
    "ragged": ({"mask": "ragged"}, _FLAT),
    "holes": ({"mask": "holes"}, _FLAT),
}
"""What is the matter: job options, and the cases it is tried on."""

_SQUARE = 30  # mm, of the table's pattern
_LIGHT, _DARK = (225, 214, 190), (120, 90, 66)  # RGB
_CUT = 4  # px, at least, of what a border cuts off
_BY = 2  # px, by which a mask's edge is off


def outline_jobs(seed: int, starts: int) -> dict[str, Row]:
    """Every episode under keys ``condition/target/placement/k``."""
    return {
        f"{name}/{target}/{placement}/{k}": {"target": target, "placement": placement, "seed": seed, "k": k, **options}
        for name, (options, cases) in CONDITIONS.items()
        for target, placement in cases
        for k in range(starts)
    }


def outline_once(job: Mapping[str, Any]) -> Row:
    """One episode: the judgement of our planner, angles in deg.

    A job has ``target``, ``placement``, ``seed``, ``k`` (the number of the start); optionally ``beside`` (things that
    touch the object), ``pattern`` (whether the table has one), ``mask`` (what is wrong with it: a condition's name) and
    ``cut`` (on how many sides the picture's border then cuts all that was seen; the solid is fitted to what is left).
    """
    kind = tuple(str(job.get(name)) for name in ("target", "placement", "beside", "pattern"))
    cell = _kept.get(kind, lambda: _cell(job))
    begin(cell, job["k"], job["seed"])
    segmenter: Segmenter = cell.segmenter
    if "mask" in job:
        segmenter = Spoilt(segmenter, job["mask"], np.random.default_rng([job["seed"], job["k"]]))
    plan, judged = run_episode(cell, SpreadViews(segmenter, keep_images="cut" in job))
    row = {"total": judged.total, "outcome": str(judged.outcome), "views": judged.views, "frames": judged.frames}
    if "cut" not in job or len(plan.views) < MIN_VIEWS:
        return row
    views, lens = cut(plan.views, cell.arm.intrinsics, segmenter, job["cut"])
    solid = ContourFit().fit(views, lens)
    if solid is None or not all(view.clipped for view in views):
        return row | {"outcome": str(Outcome.TOO_FEW_VIEWS)}
    found = Outcome.ALIGNED if solid.explains else Outcome.UNEXPLAINED
    return row | {"total": float(np.degrees(cell.truth.normal.angle(solid.normal))), "outcome": str(found)}


def cut(
    views: Sequence[View], intrinsics: CameraIntrinsics, segmenter: Segmenter, sides: int
) -> tuple[list[View], CameraIntrinsics]:
    """The strip of all pictures whose left border, or left and right, cut the object in each; and its lens."""
    columns = [view.outline.points[:, 0] for view in views if view.outline is not None]
    left = round(max(each.min() for each in columns)) + _CUT
    right = round(min(each.max() for each in columns)) - _CUT if sides == 2 else intrinsics.width
    lens = replace(intrinsics, width=right - left, cx=intrinsics.cx - left)
    parts = []
    for view in views:
        assert view.rgb is not None
        rgb = np.ascontiguousarray(view.rgb[:, left:right])
        blob = max(blobs_from_mask(segmenter(rgb)), key=lambda each: each.area)
        outline, shape = Outline.of(blob, rgb), (rgb.shape[0], rgb.shape[1])
        parts.append(replace(view, blob=blob, clipped=blob.touches_border(shape), outline=outline, rgb=rgb))
    return parts, lens


def _cell(job: Mapping[str, Any]) -> WorkCell:
    cell = WorkCell(
        "baxter",
        job["target"],
        job["placement"],
        noise=Noise.thesis(),
        others=job.get("beside", ()),
        touching="beside" in job,
    )
    if job.get("pattern"):
        model = cell.model
        texture = model.texture("floor")
        mm = 1000 / (2 * texture.width[0])  # of a pixel: two of it go on a meter
        square = (np.indices((texture.height[0], texture.width[0])) // round(_SQUARE / mm)).sum(axis=0) % 2
        begins = int(model.tex_adr[texture.id])
        pixels = np.where(square[..., None] == 0, _LIGHT, _DARK).astype(np.uint8)
        model.tex_data[begins : begins + pixels.size] = pixels.ravel()
        model.geom("table").matid = model.material("floor").id
    return cell


_kept: CellCache[WorkCell] = CellCache()


@dataclass(frozen=True)
class Spoilt:
    """A segmenter whose masks are wrong in one way."""

    segmenter: Segmenter
    how: str
    rng: np.random.Generator

    def __call__(self, rgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Mask of a picture."""
        mask = np.asarray(self.segmenter(rgb)).astype(np.uint8)
        disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * _BY + 1, 2 * _BY + 1))
        if self.how == "eroded":
            return cv2.erode(mask, disk) > 0
        if self.how == "dilated":
            return cv2.dilate(mask, disk) > 0
        if self.how == "ragged":  # the edge is anywhere within so much of where it should be
            inward, outward = (cv2.distanceTransform(each, cv2.DIST_L2, 5) for each in (mask, 1 - mask))
            return np.asarray(inward - outward > self.rng.uniform(-_BY, _BY, mask.shape))
        v, u = np.nonzero(mask)
        for k in self.rng.integers(0, max(1, len(u)), 6 if len(u) else 0):
            cv2.circle(mask, (int(u[k]), int(v[k])), int(self.rng.integers(2, 7)), 0, -1)
        return mask > 0


def outline_report(rows: Mapping[str, Row]) -> Row:
    """Content of the stored result, of rows of :func:`outline_once`: ``summary``, by condition and case, and by
    condition over its cases, of all plans and of those that ended ``aligned``; and ``rows``, every error; deg.
    """
    cases = by_case(rows)
    together: dict[str, list[Row]] = {}
    for case, group in cases.items():
        together.setdefault(case.split("/")[0], []).extend(group)
    return {
        "noise": noise_fields(Noise.thesis()),
        "summary": {name: _described(group) for name, group in (together | cases).items()},
        "rows": {case: [round(row["total"], 2) for row in group] for case, group in cases.items()},
    }


def _described(group: Sequence[Row]) -> Row:
    aligned = [row["total"] for row in group if row["outcome"] == Outcome.ALIGNED]
    return {
        "error": summarize([row["total"] for row in group]),
        "outcomes": dict(Counter(row["outcome"] for row in group)),
        "aligned": summarize(aligned) if aligned else None,
        **{name: float(np.mean([row[name] for row in group])) for name in ("views", "frames")},
    }


def _status(rows: Sequence[Row]) -> str:
    return f"median {np.median([row['total'] for row in rows]):.2f} deg" if rows else ""


EXPERIMENT = Experiment(outline_once, outline_jobs, outline_report, starts=24, status=_status)
"""Twenty-four starts a case."""
