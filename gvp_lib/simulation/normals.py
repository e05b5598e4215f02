"""Which way an object may be grasped: its canonical normals, and the one that is accepted as it is placed.

This is the judge's side of the thesis's reward (2.4.2, Eq. 2.10; errata 16): planners never see it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError

__all__ = ["AcceptedNormal", "CanonicalNormal", "accepted_normal"]

_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class CanonicalNormal:
    """A direction from which an object may well be grasped, in the object's frame.

    Attributes
    ----------
    direction
        Outward unit vector, shape (3,): a camera that looks along its reverse is aligned.
    major_axis
        Unit vector across it, shape (3,), with which the camera's y axis is to align (thesis 2.3: the gripper
        then closes across the minor axis). None where any roll will do.
    symmetry
        Two rolls that differ by this angle are equally good, rad: pi for an oblong face, pi/2 for a square
        one, 0 where any roll will do.
    """

    direction: NDArray[np.float64]
    major_axis: NDArray[np.float64] | None = None
    symmetry: float = 0.0

    def __post_init__(self) -> None:
        direction = _unit(self.direction, "a canonical normal's direction")
        object.__setattr__(self, "direction", direction)
        if (self.major_axis is None) != (self.symmetry == 0) or not 0 <= self.symmetry <= 2 * np.pi:
            raise InvalidParameterError(
                "a normal has a major axis and a symmetry in (0, 2 pi] rad, or no major axis and symmetry 0; "
                f"got major_axis={self.major_axis}, symmetry={self.symmetry}"
            )
        if self.major_axis is not None:
            major = _unit(self.major_axis, "a major axis")
            if abs(major @ direction) > 1e-6:
                raise InvalidParameterError(
                    f"the major axis lies across the normal; {major.tolist()} and {direction.tolist()} "
                    f"are {np.degrees(np.arccos(np.clip(major @ direction, -1, 1))):.1f} deg apart, not 90"
                )
            object.__setattr__(self, "major_axis", major)


@dataclass(frozen=True, eq=False)
class AcceptedNormal:
    """What counts as aligned for an object as it is placed, in the world frame.

    Attributes
    ----------
    direction
        Outward unit vector, shape (3,). For a lying can, the member of the circle nearest the vertical.
    major_axis, symmetry
        As in :class:`CanonicalNormal`.
    circle_axis
        Unit vector, shape (3,), or None. Where it is given, every direction across it is accepted: the whole
        circle about a lying can.
    """

    direction: NDArray[np.float64]
    major_axis: NDArray[np.float64] | None = None
    symmetry: float = 0.0
    circle_axis: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        for name in ("direction", "major_axis", "circle_axis"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, _unit(value, name))

    def rotated(self, rotation: Rotation) -> AcceptedNormal:
        """The same, on an object that has turned by ``rotation`` in the world frame."""
        matrix = rotation.as_matrix()  # SciPy's `apply` refuses read-only vectors
        major, circle = (None if v is None else matrix @ v for v in (self.major_axis, self.circle_axis))
        return AcceptedNormal(matrix @ self.direction, major, self.symmetry, circle)

    def nearest(self, direction: ArrayLike) -> NDArray[np.float64]:
        """The accepted unit vector nearest to ``direction``, world frame, shape (3,).

        It is ``self.direction`` unless a whole circle is accepted; along that circle's axis all its members
        are equally far, and ``self.direction`` is returned.
        """
        if self.circle_axis is None:
            return self.direction
        d = _unit(direction, "a viewing direction")
        across = d - (d @ self.circle_axis) * self.circle_axis
        norm = np.linalg.norm(across)
        return self.direction if norm < 1e-9 else across / norm

    def angle(self, direction: ArrayLike) -> float:
        """Angle between an outward direction, from object to camera, and what is accepted, rad in [0, pi].

        This is the viewpoint error when ``direction`` is the reversed optical axis (errata 16).
        """
        d, n = _unit(direction, "a viewing direction"), self.nearest(direction)
        # Unlike the arc cosine, exact for small angles.
        return float(np.arctan2(np.linalg.norm(np.cross(d, n)), d @ n))

    def view_angle(self, world_from_camera: RigidTransform) -> float:
        """:meth:`angle` of the reversed optical axis of a camera (z forward), rad."""
        return self.angle(-world_from_camera.rotation.apply(_UP))

    def roll_error(self, world_from_camera: RigidTransform) -> float:
        """The roll that a camera has yet to make, rad, in (-symmetry/2, symmetry/2].

        Positive from the camera's x towards its y axis, about its optical axis (``rotate_wrist``'s sense),
        until the y axis aligns with the projected major axis. 0 where any roll will do; NaN where the camera
        looks along the major axis, which then has no direction in the image.
        """
        if self.major_axis is None:
            return 0.0
        mx, my, _ = world_from_camera.rotation.as_matrix().T @ self.major_axis
        if np.hypot(mx, my) < 1e-9:
            return float("nan")
        roll = np.arctan2(-mx, my)
        # ceil, not round: the half-open interval keeps its upper end.
        return float(roll - self.symmetry * np.ceil(roll / self.symmetry - 0.5))


def accepted_normal(
    normals: Sequence[CanonicalNormal], round_axis: ArrayLike | None, world_from_object: RigidTransform
) -> AcceptedNormal:
    """The canonical normal nearest the vertical as placed; the earlier of two that are equally near.

    Parameters
    ----------
    normals
        Canonical normals, object frame.
    round_axis
        Shape (3,), object frame, or None. Every direction across it is canonical too, with the axis itself as
        major axis and half a turn of symmetry.
    world_from_object
        The object's pose.
    """
    rotation = world_from_object.rotation.as_matrix()  # Rotation.apply refuses read-only arrays
    candidates = [
        AcceptedNormal(
            rotation @ n.direction,
            None if n.major_axis is None else rotation @ n.major_axis,
            n.symmetry,
        )
        for n in normals
    ]
    if round_axis is not None:
        axis = rotation @ _unit(round_axis, "a round axis")
        # For a standing can the circle is level and its "nearest member" arbitrary; it is never chosen then.
        up = _UP - axis[2] * axis
        if np.linalg.norm(up) > 1e-9:
            candidates.append(AcceptedNormal(up, axis, np.pi, circle_axis=axis))
    # Rounded, so that a pose's last bits do not decide between a brick's two level faces.
    return min(candidates, key=lambda n: round(n.angle(_UP), 9))


def _unit(vector: ArrayLike, what: str) -> NDArray[np.float64]:
    """A read-only unit vector."""
    array = np.array(vector, float)
    norm = np.linalg.norm(array)
    if array.shape != (3,) or not np.isfinite(norm) or norm < 1e-12:
        raise InvalidParameterError(f"{what} is a finite vector of shape (3,), not zero; got {vector!r}")
    array /= norm
    array.flags.writeable = False
    return array
