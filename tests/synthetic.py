"""Views and arcs that no camera took, of given ratios or of exact silhouettes; and solids for a `PinholeArm`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from eye_in_hand import CAMERA, PinholeArm
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.motion.arc import Arc, ArcEnd, Axis
from gvp_lib.motion.primitives import turn
from gvp_lib.motion.sighting import View
from gvp_lib.perception.moments import Blob
from gvp_lib.planning.solids import BOX, Shape, silhouette_moments

PIXEL = 1 / 12  # px^2: a filled region's inertia less that of point masses, per pixel

_STANDING = Rotation.identity()
_BITS = 8  # of a pixel's fraction, for OpenCV


@dataclass(frozen=True)
class Block:
    """A box or a can about the origin, for a `PinholeArm`; +z up unless turned, by default with y along its length."""

    sizes: tuple[float, float, float] = (0.032, 0.064, 0.02)
    shape: Shape = BOX
    rotation: Rotation = _STANDING

    def draw(self, image: NDArray[np.uint8], camera: CameraIntrinsics, camera_from_base: RigidTransform) -> None:
        corners = self.rotation.apply(self.shape.vertices(np.array([*self.sizes, 0, 0])))
        x = camera_from_base.apply(corners)
        if (x[:, 2] > 0.01).all():
            outline = cv2.convexHull(np.rint(camera.project(x) * 2**_BITS).astype(np.int32))
            cv2.fillConvexPoly(image, outline, (255, 255, 255), cv2.LINE_8, _BITS)


def over_block(*shapes: Any, arm: type[PinholeArm] = PinholeArm, **options: Any) -> PinholeArm:
    """An arm over a block, or other shapes, as an episode may begin: 23 deg off the face's normal, 0.3 m away."""
    return arm(*(shapes or (Block(),)), **{"radius": 0.3, "tilt": 0.4, "azimuth": 2.0, **options})


def _arc(axis: Axis, views: Sequence[View], center: int) -> Arc:
    return Arc(axis, tuple(views), center, (ArcEnd.ANGLE, ArcEnd.ANGLE), np.full(len(views), np.nan))


def arc_of_ratios(ratios: ArrayLike, center: int | None = None, angles: ArrayLike | None = None) -> Arc:
    """An arc along y whose views have these ratios; the first joint of each view is its number."""
    values = np.asarray(ratios, float)
    center = len(values) // 2 if center is None else center
    swept = 0.08 * (np.arange(len(values)) - center) if angles is None else np.asarray(angles, float)
    views = []
    for k, (ratio, angle) in enumerate(zip(values, swept, strict=True)):
        blob = Blob(4000, CAMERA.principal_point, (40 * ratio) ** 2, 0.0, 40.0**2, (200, 100, 400, 300))
        views.append(View(np.array([k, 0.0]), turn([angle, 0.0, 0.0]), blob))
    return _arc("y", views, center)


def cross_of_viewpoints(
    center: ArrayLike, tilt: float = 0.0, azimuth: float = 0.0, spread: float = np.radians(50), n: int = 9
) -> list[list[RigidTransform]]:
    """Two arcs of ``n`` poses each about one viewpoint 0.25 m away: along its y axis, and along its x axis."""
    middle = VirtualSphere(np.asarray(center, float), 0.25).viewpoint(tilt, azimuth)
    ahead = RigidTransform.from_translation([0.0, 0.0, 0.25])
    angles = np.linspace(-spread, spread, n)
    return [[middle * ahead * turn(a * axis) * ahead.inv() for a in angles] for axis in np.eye(3)[:2]]


def arcs_of_solid(
    shape: Shape,
    base_from_solid: RigidTransform,
    sizes: ArrayLike,
    viewpoints: Sequence[Sequence[RigidTransform]],
    errors: NDArray[np.float64] | None = None,
    noise: NDArray[np.float64] | None = None,
) -> list[Arc]:
    """Arcs over a solid, which cameras see to the last digit but for the area's.

    Parameters
    ----------
    errors
        Where each view truly was against what its arm believes, in its own camera frame: rotation vector (rad) and
        translation (m), shape (views of all arcs, 6).
    noise
        Added to the centroid and the two standard deviations, shape (views of all arcs, 4), px.
    """
    count = sum(map(len, viewpoints))
    errors = np.zeros((count, 6)) if errors is None else errors
    noise = np.zeros((count, 4)) if noise is None else noise
    views = []
    for pose, error, (du, dv, d20, d02) in zip((p for poses in viewpoints for p in poses), errors, noise, strict=True):
        true = pose * RigidTransform.from_components(error[3:], Rotation.from_rotvec(error[:3]))
        seen = true.inv() * base_from_solid
        moments, _ = silhouette_moments(
            shape, seen.rotation.as_matrix(), seen.translation, np.asarray(sizes, float), CAMERA
        )
        area, u, v, mu20, mu11, mu02 = (float(x) for x in moments)
        mu20, mu02 = (mu20**0.5 + d20) ** 2 - PIXEL, (mu02**0.5 + d02) ** 2 - PIXEL
        blob = Blob(round(area), np.array([u + du, v + dv]), mu20, mu11, mu02, (100, 100, 500, 400))
        views.append(View(np.concatenate([pose.translation, pose.rotation.as_rotvec()]), pose, blob))
    each = np.split(np.arange(count), np.cumsum([len(poses) for poses in viewpoints])[:-1])
    axes: tuple[Axis, Axis] = ("y", "x")
    return [_arc(axis, [views[k] for k in ks], len(ks) // 2) for axis, ks in zip(axes, each, strict=True)]
