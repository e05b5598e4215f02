"""Views and arcs that no camera took, of given ratios or of exact silhouettes; and solids for a `PinholeArm`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from eye_in_hand import CAMERA
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.motion.arc import Arc, ArcEnd
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


def view_of_ratio(ratio: float, angle: float = 0.0, joint: float = 0.0) -> View:
    """A view whose blob has a ratio, from a camera that has swept ``angle`` rad along its y axis."""
    blob = Blob(4000, CAMERA.principal_point, (40 * ratio) ** 2, 0.0, 40.0**2, (200, 100, 400, 300))
    pose = RigidTransform.from_rotation(Rotation.from_rotvec([angle, 0.0, 0.0]))
    return View(np.array([joint, 0.0]), pose, blob)


def arc_of_ratios(ratios: ArrayLike, center: int | None = None, angles: ArrayLike | None = None) -> Arc:
    """An arc whose views have these ratios; the first joint of each view is its number."""
    values = np.asarray(ratios, float)
    center = len(values) // 2 if center is None else center
    swept = 0.08 * (np.arange(len(values)) - center) if angles is None else np.asarray(angles, float)
    views = [view_of_ratio(r, a, k) for k, (r, a) in enumerate(zip(values, swept, strict=True))]
    return Arc("y", tuple(views), center, (ArcEnd.ANGLE, ArcEnd.ANGLE), np.full(len(views), np.nan))


def view_of_solid(
    shape: Shape,
    base_from_solid: RigidTransform,
    sizes: ArrayLike,
    base_from_camera: RigidTransform,
    believed: RigidTransform | None = None,
    noise: ArrayLike = 0.0,
) -> View:
    """What a camera sees of a solid, to the last digit but for the area's, and where its arm believes it stood.

    ``noise`` is added to the centroid and the two standard deviations, shape (4,), px.
    """
    seen = base_from_camera.inv() * base_from_solid
    moments = silhouette_moments(shape, seen.rotation.as_matrix(), seen.translation, np.asarray(sizes, float), CAMERA)
    area, u, v, mu20, mu11, mu02 = (float(x) for x in moments)
    du, dv, d20, d02 = np.broadcast_to(noise, 4)
    blob = Blob(
        round(area), np.array([u + du, v + dv]), (mu20**0.5 + d20) ** 2 - PIXEL, mu11, (mu02**0.5 + d02) ** 2 - PIXEL,
        (100, 100, 500, 400),
    )  # fmt: skip
    pose = base_from_camera if believed is None else believed
    return View(np.concatenate([pose.translation, pose.rotation.as_rotvec()]), pose, blob)


def cross_of_viewpoints(
    center: ArrayLike, tilt: float = 0.0, azimuth: float = 0.0, spread: float = np.radians(50), n: int = 9,
    radius: float = 0.25,
) -> tuple[list[RigidTransform], list[RigidTransform]]:  # fmt: skip
    """Two arcs of ``n`` poses each about one viewpoint: along its y axis, and along its x axis."""
    middle = VirtualSphere(np.asarray(center, float), radius).viewpoint(tilt, azimuth)
    ahead = RigidTransform.from_translation([0.0, 0.0, radius])

    def swept(axis: NDArray[np.float64]) -> list[RigidTransform]:
        turns = [RigidTransform.from_rotation(Rotation.from_rotvec(a * axis)) for a in np.linspace(-spread, spread, n)]
        return [middle * ahead * turn * ahead.inv() for turn in turns]

    return swept(np.array([1.0, 0.0, 0.0])), swept(np.array([0.0, 1.0, 0.0]))


def arcs_of_solid(
    shape: Shape,
    base_from_solid: RigidTransform,
    sizes: ArrayLike,
    viewpoints: Sequence[Sequence[RigidTransform]],
    errors: NDArray[np.float64] | None = None,
    noise: NDArray[np.float64] | None = None,
) -> list[Arc]:
    """Arcs over a solid.

    ``errors``, shape (views of all arcs, 6), are where each view truly was against what its arm believes, in its own
    camera frame: rotation vector (rad) and translation (m). ``noise`` is (views of all arcs, 4); see `view_of_solid`.
    """
    arcs, k = [], 0
    for axis, poses in zip("yx", viewpoints, strict=False):
        views = []
        for pose in poses:
            turn, shift = (np.zeros(3), np.zeros(3)) if errors is None else (errors[k, :3], errors[k, 3:])
            true = pose * RigidTransform.from_components(shift, Rotation.from_rotvec(turn))
            views.append(view_of_solid(shape, base_from_solid, sizes, true, pose, 0.0 if noise is None else noise[k]))
            k += 1
        ends = (ArcEnd.ANGLE, ArcEnd.ANGLE)
        arcs.append(Arc("y" if axis == "y" else "x", tuple(views), len(views) // 2, ends, np.full(len(views), np.nan)))
    return arcs
