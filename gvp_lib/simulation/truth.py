"""The judge's side: which way an object may be grasped, and where it and the camera truly are.

A planner that reads any of it is a defect. Canonical normals are the object's own; the accepted one is the nearest to
the vertical as it is placed (thesis 2.4.2, Eq. 2.10; errata 16).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError
from gvp_lib.simulation.camera import camera_pose

__all__ = ["AcceptedNormal", "CanonicalNormal", "Truth", "unit_vector"]


@dataclass(frozen=True, eq=False)
class CanonicalNormal:
    """Direction from which an object is well grasped, in the object's frame.

    Attributes
    ----------
    direction
        Outward unit vector, shape (3,). A camera that looks along its reverse is aligned.
    major_axis
        Unit vector, shape (3,), perpendicular to it, with which the camera's y axis should align (thesis 2.3: the
        gripper then closes across the minor axis). None where any roll will do.
    symmetry
        Roll symmetry, rad: pi for an oblong face, pi/2 for a square one, 0 where any roll will do.
    """

    direction: NDArray[np.float64]
    major_axis: NDArray[np.float64] | None = None
    symmetry: float = 0.0

    def __post_init__(self) -> None:
        direction = unit_vector(self.direction, "a normal's direction")
        object.__setattr__(self, "direction", direction)
        if (self.major_axis is None) != (self.symmetry == 0) or not 0 <= self.symmetry <= 2 * np.pi:
            raise InvalidParameterError(
                "a normal has a major axis and a symmetry in (0, 2 pi] rad, or no major axis and symmetry 0; "
                f"got major_axis={self.major_axis}, symmetry={self.symmetry}"
            )
        if self.major_axis is not None:
            major = unit_vector(self.major_axis, "a major axis")
            if abs(major @ direction) > 1e-6:
                raise InvalidParameterError(
                    f"the major axis lies across the normal; {major.tolist()} and {direction.tolist()} "
                    f"are {np.degrees(np.arccos(np.clip(major @ direction, -1, 1))):.1f} deg apart, not 90"
                )
            object.__setattr__(self, "major_axis", major)


@dataclass(frozen=True, eq=False)
class AcceptedNormal(CanonicalNormal):
    """Canonical normal that counts as aligned for an object as placed, in the world frame.

    Attributes
    ----------
    circle_axis
        Unit vector, shape (3,), or None. Every direction perpendicular to it is accepted: the circle about a lying
        can, of which ``direction`` is the member nearest the vertical.
    """

    circle_axis: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.circle_axis is not None:
            object.__setattr__(self, "circle_axis", unit_vector(self.circle_axis, "a circle's axis"))

    def rotated(self, rotation: Rotation) -> AcceptedNormal:
        """Accepted normal after the object has turned by ``rotation`` in the world frame."""
        matrix = rotation.as_matrix()  # SciPy's `apply` refuses read-only vectors
        major, circle = (None if v is None else matrix @ v for v in (self.major_axis, self.circle_axis))
        return AcceptedNormal(matrix @ self.direction, major, self.symmetry, circle)

    def nearest(self, direction: ArrayLike) -> NDArray[np.float64]:
        """Accepted unit vector nearest to ``direction``, world frame, shape (3,).

        ``self.direction``, unless a whole circle is accepted; also along that circle's axis, from which all its
        members are equally far.
        """
        if self.circle_axis is None:
            return self.direction
        d = unit_vector(direction, "a viewing direction")
        across = d - (d @ self.circle_axis) * self.circle_axis
        norm = np.linalg.norm(across)
        return self.direction if norm < 1e-9 else across / norm

    def angle(self, direction: ArrayLike) -> float:
        """Angle between an outward direction, from object to camera, and the accepted normal, rad in [0, pi].

        The viewpoint error, when ``direction`` is the reversed optical axis (errata 16).
        """
        d, n = unit_vector(direction, "a viewing direction"), self.nearest(direction)
        # Unlike the arc cosine, exact for small angles.
        return float(np.arctan2(np.linalg.norm(np.cross(d, n)), d @ n))

    def view_angle(self, world_from_camera: RigidTransform) -> float:
        """:meth:`angle` of a camera's reversed optical axis, rad."""
        return self.angle(-world_from_camera.rotation.apply([0.0, 0.0, 1.0]))

    def roll_error(self, world_from_camera: RigidTransform) -> float:
        """Roll left until a camera's y axis aligns with the projected major axis, rad, in (-symmetry/2, symmetry/2].

        Positive from the camera's x toward its y axis, about its optical axis, as ``rotate_wrist`` counts it. 0 where
        any roll will do; NaN where the camera looks along the major axis, which then has no direction in the image.
        """
        if self.major_axis is None:
            return 0.0
        mx, my, _ = world_from_camera.rotation.as_matrix().T @ self.major_axis
        if np.hypot(mx, my) < 1e-9:
            return float("nan")
        roll = np.arctan2(-mx, my)
        # ceil, not round: the half-open interval keeps its upper end.
        return float(roll - self.symmetry * np.ceil(roll / self.symmetry - 0.5))


class Truth:
    """True poses in the current episode, at the moment of asking."""

    def __init__(
        self, data: mujoco.MjData, target_body: int, camera: int, normal: Callable[[RigidTransform], AcceptedNormal]
    ) -> None:
        self._data, self._body, self._camera, self._normal = data, target_body, camera, normal

    def begin_episode(self) -> None:
        """Judge by the object as it stands now; called by the cell's ``reset``."""
        self._as_placed = self.world_from_object
        self._accepted = self._normal(self._as_placed)

    @property
    def world_from_object(self) -> RigidTransform:
        """Current pose of the object."""
        rotation = Rotation.from_matrix(self._data.xmat[self._body].reshape(3, 3))
        return RigidTransform.from_components(self._data.xpos[self._body], rotation)

    @property
    def world_from_camera(self) -> RigidTransform:
        """Current pose of the camera (optical frame), encoder errors included."""
        return camera_pose(self._data, self._camera)

    @property
    def normal(self) -> AcceptedNormal:
        """Accepted normal of the object as it was placed, carried along should the object move."""
        return self._accepted.rotated((self.world_from_object * self._as_placed.inv()).rotation)

    def viewpoint_error(self) -> float:
        """Angle between the reversed optical axis and the object's accepted normal, rad (Eq. 2.10; errata 16)."""
        return self.normal.view_angle(self.world_from_camera)

    def roll_error(self) -> float:
        """Roll left until the camera's y axis aligns with the major axis, rad: :meth:`AcceptedNormal.roll_error`."""
        return self.normal.roll_error(self.world_from_camera)


def unit_vector(vector: ArrayLike, what: str) -> NDArray[np.float64]:
    """Read-only unit vector along a vector of shape (3,), which ``what`` names in the error text."""
    array = np.array(vector, float)
    norm = np.linalg.norm(array)
    if array.shape != (3,) or not np.isfinite(norm) or norm < 1e-12:
        raise InvalidParameterError(f"{what} is a finite vector of shape (3,), not zero; got {vector!r}")
    array /= norm
    array.flags.writeable = False
    return array
