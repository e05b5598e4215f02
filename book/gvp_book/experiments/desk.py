"""How well an object is found in photographs of it: on the sheet, by the public call alone; and which segmenter finds
packaging best without one.

The photographs are rendered: :mod:`gvp_book.experiments.photographs`. A start is a package, its place, a print, a
light, a desk, and the hands that held the telephone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gvp_book.experiments.photographs import PACKAGES, Desk, photographed
from gvp_book.results import Experiment, Row, by_case
from gvp_lib import ContourFit
from gvp_lib.errors import GvpError
from gvp_lib.perception import GrabCut, HsvThreshold, LearnedSegmenter, Saliency, Whole
from gvp_lib.photographs import views_from_photographs

COUNT, SIZE, BARE = 10, (1600, 1200), (800, 600)
"""Photographs of a start, and their size with and without the sheet, px."""

MARKED = 4
"""Photographs of a bare desk that are marked by hand, for what learns from them; the others are judged."""

PAD = 12
"""Pixels about the object, of the box from which GrabCut begins."""

Mask = NDArray[np.bool_]


def desk_jobs(seed: int, starts: int) -> dict[str, Row]:
    """Jobs of all starts, with keys ``sheet or bare/package/k``."""
    return {
        f"{desk}/{name}/{k}": {"desk": desk, "package": name, "seed": seed + k}
        for desk in ("sheet", "bare")
        for name in PACKAGES
        for k in range(starts)
    }


def desk_once(job: Mapping[str, Any]) -> Row:
    """One start, a job of :func:`desk_jobs`.

    On the sheet: ``views``, how many photographs were of use; ``iou`` of each one's silhouette; and of the solid
    ``explains``, ``kind``, ``error``, deg, between its normal and the package's nearest axis, ``sizes``, mm, and
    ``claimed``, deg, the radius of its 90 % region. On the bare desk: mean ``iou`` of each segmenter, by name.
    """
    if job["desk"] == "bare":
        return {"iou": _judged(photographed(job["package"], job["seed"], COUNT, BARE, bare=True))}
    desk = photographed(job["package"], job["seed"], COUNT, SIZE)
    try:
        seen = views_from_photographs(desk.pictures, desk.sheet)
    except GvpError as error:
        return {"not found": str(error)}
    lens, bent = seen.lens.intrinsics, seen.lens.distortion
    size, found = (seen.intrinsics.width, seen.intrinsics.height), []
    for name, view in zip(seen.files, seen.views, strict=True):
        straight = cv2.undistort(desk.masks[int(name.split()[-1])].astype(np.float32), lens.matrix, bent)
        true = np.asarray(cv2.resize(straight, size, interpolation=cv2.INTER_AREA) > 0.5)
        found.append(_iou(view.blob.mask(true.shape), true))
    row: Row = {"views": len(seen.views), "iou": found}
    solid = ContourFit().estimate([seen.arc], seen.intrinsics).solid
    if solid is None:
        return row | {"explains": False}
    axes = desk.sheet_from_package.rotation.as_matrix()
    along = np.abs(axes.T @ solid.normal)
    if desk.package.kind == "cylinder":  # whatever is across its axis is an axis
        along[:2] = np.hypot(*along[:2])
    return row | {
        "explains": solid.explains,
        "kind": solid.kind == desk.package.kind,
        "error": float(np.degrees(np.arccos(min(1.0, along.max())))),
        "sizes": (1000 * (np.sort(solid.lengths) - np.sort(desk.package.lengths))).tolist(),
        "claimed": float(np.degrees(solid.within(0.9))),
    }


def _judged(desk: Desk) -> Row:
    pictures, masks = desk.pictures, desk.masks
    learned = LearnedSegmenter(pictures[:MARKED], masks[:MARKED])
    hue = HsvThreshold.from_region(pictures[0], masks[0])
    rest = list(zip(pictures[MARKED:], masks[MARKED:], strict=True))

    def mean(segment: Callable[[Any, Mask], Mask]) -> float:
        return float(np.mean([_iou(segment(rgb, mask), mask) for rgb, mask in rest]))

    return {
        "one hue": mean(lambda rgb, _: hue(rgb)),
        "one hue, whole": mean(lambda rgb, _: Whole(hue)(rgb)),
        "one hue, hull": mean(lambda rgb, _: Whole(hue, hull=True)(rgb)),
        "saliency": mean(lambda rgb, _: Saliency()(rgb)),
        "saliency, GrabCut": mean(lambda rgb, _: Whole(GrabCut(Saliency()))(rgb)),
        "box, GrabCut": mean(lambda rgb, mask: Whole(GrabCut(_about(mask)))(rgb)),
        "learned": mean(lambda rgb, _: learned(rgb)),
    }


def _about(mask: Mask) -> tuple[int, int, int, int]:
    (v, u), (height, width) = np.nonzero(mask), mask.shape
    low, high = max(0, int(u.min()) - PAD), min(width, int(u.max()) + PAD + 1)
    return low, max(0, int(v.min()) - PAD), high, min(height, int(v.max()) + PAD + 1)


def _iou(one: Mask, other: Mask) -> float:
    return float((one & other).sum() / max(1, (one | other).sum()))


def desk_report(rows: Mapping[str, Row]) -> Row:
    """Content of the stored result, from rows of :func:`desk_once` with the keys of :func:`desk_jobs`.

    ``sheet``: of each package and of ``all``, n, the share that a solid ``explains``, and of these the median and the
    worst normal, deg, side, mm, and IoU; ``within``, the share of errors within their claimed 90 % region. ``bare``:
    mean and worst IoU by segmenter and package. ``rows``: every start.
    """
    groups = by_case(rows)
    of_sheet = {case.split("/")[1]: group for case, group in groups.items() if case.startswith("sheet/")}
    of_bare = {case.split("/")[1]: group for case, group in groups.items() if case.startswith("bare/")}
    sheet = {name: _summary(group) for name, group in of_sheet.items()}
    bare: Row = {}
    for name, group in of_bare.items():
        for which in group[0]["iou"]:
            each = [row["iou"][which] for row in group]
            bare.setdefault(which, {})[name] = {"mean": float(np.mean(each)), "worst": min(each)}
    everything = [row for group in of_sheet.values() for row in group]
    return {"sheet": sheet | {"all": _summary(everything)}, "bare": bare, "rows": dict(rows)}


def _summary(group: list[Row]) -> Row:
    told = [row for row in group if row.get("explains")]
    iou = [each for row in group for each in row.get("iou", [])]
    errors, sizes = [row["error"] for row in told], [max(map(abs, row["sizes"])) for row in told]
    found: Row = {"n": len(group), "explains": len(told) / len(group)}
    if iou:
        found["iou"] = {"median": float(np.median(iou)), "worst": min(iou)}
    if told:
        found |= {
            "kind": sum(row["kind"] for row in told) / len(told),
            "error": {"median": float(np.median(errors)), "worst": max(errors)},
            "sizes": {"median": float(np.median(sizes)), "worst": max(sizes)},
            "within": sum(row["error"] <= row["claimed"] for row in told) / len(told),
        }
    return found


EXPERIMENT = Experiment(desk_once, desk_jobs, desk_report, starts=10)
"""Photographs."""
