"""Arcs that no camera took, and solids for a `PinholeArm`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from eye_in_hand import CAMERA, PinholeArm
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_book.experiments.alignment import SIZES
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arc import Arc, Axis
from gvp_lib.motion.arm import Outcome
from gvp_lib.motion.primitives import turn
from gvp_lib.motion.sighting import View
from gvp_lib.perception.blobs import Blob
from gvp_lib.planning.solids import BOX, FittedSolid, Shape

_STANDING = Rotation.identity()
_BITS = 8  # of a pixel's fraction, for OpenCV


@dataclass(frozen=True)
class Block:
    """A box or a can, for a `PinholeArm`; about the origin, +z up, unless moved or turned, and y along its length."""

    sizes: tuple[float, float, float] = (0.032, 0.064, 0.02)
    shape: Shape = BOX
    rotation: Rotation = _STANDING
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def draw(self, image: NDArray[np.uint8], camera: CameraIntrinsics, camera_from_base: RigidTransform) -> None:
        corners = self.rotation.apply(self.shape.vertices(np.array([*self.sizes, 0, 0]))) + self.center
        x = camera_from_base.apply(corners)
        if (x[:, 2] > 0.01).all():
            outline = cv2.convexHull(np.rint(camera.project(x) * 2**_BITS).astype(np.int32))
            cv2.fillConvexPoly(image, outline, (255, 255, 255), cv2.LINE_8, _BITS)


def over_block(*shapes: Any, arm: type[PinholeArm] = PinholeArm, **options: Any) -> PinholeArm:
    """An arm over a block, or other shapes, as an episode may begin: 23 deg off the face's normal, 0.3 m away."""
    return arm(*(shapes or (Block(),)), **{"radius": 0.3, "tilt": 0.4, "azimuth": 2.0, **options})


def size_error(solid: FittedSolid, target: str) -> float:
    """Largest error of a fitted solid's lengths, m: of a brick's body without studs, of a can with its cap."""
    lengths = solid.lengths if solid.kind == "cylinder" else solid.sizes
    return float(np.abs(np.sort(lengths) - np.sort(SIZES[target])).max())


def arc_of_views(axis: Axis, views: Sequence[View], center: int | None = None) -> Arc:
    """An arc that began at the middle view, unless it is said where."""
    center = len(views) // 2 if center is None else center
    return Arc(axis, tuple(views), center, (Outcome.MAX_ANGLE, Outcome.MAX_ANGLE), np.full(len(views), np.nan))


def arc_of_ratios(ratios: ArrayLike, center: int | None = None, angles: ArrayLike | None = None) -> Arc:
    """An arc along y whose views have these ratios; the first joint of each view is its number."""
    values = np.asarray(ratios, float)
    middle = len(values) // 2 if center is None else center
    swept = 0.08 * (np.arange(len(values)) - middle) if angles is None else np.asarray(angles, float)
    views = []
    for k, (ratio, angle) in enumerate(zip(values, swept, strict=True)):
        blob = Blob(4000, CAMERA.principal_point, (40 * ratio) ** 2, 0.0, 40.0**2, (200, 100, 400, 300))
        views.append(View(np.array([k, 0.0]), turn([angle, 0.0, 0.0]), blob))
    return arc_of_views("y", views, middle)
