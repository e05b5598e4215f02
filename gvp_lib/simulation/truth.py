"""Ground truth: from where an object is best grasped, and where it and the camera truly are.

It serves to judge; a planner that reads any of it is a defect. Canonical normals belong to the object; the accepted
normal is the one nearest the vertical as the object is placed (thesis 2.4.2, Eq. 2.10; errata 16).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError
from gvp_lib.simulation.camera import camera_pose

__all__ = ["AcceptedNormal", "CanonicalNormal", "Truth", "unit_vector"]


@checked
@dataclass(frozen=True, eq=False)
class CanonicalNormal:
    """Direction from which an object is best grasped, in the object's frame.

    Parameters
    ----------
    direction
        Outward vector, shape (3,); normalized. A camera is aligned if its optical axis points the opposite way.
    major_axis
        Vector perpendicular to ``direction``, shape (3,); normalized. The camera's y axis should align with it
        (thesis 2.3: the gripper then closes across the minor axis). None if any roll will do.
    symmetry
        Roll symmetry, rad: pi for an oblong face, pi/2 for a square one, 0 if any roll will do.

    Examples
    --------
    >>> CanonicalNormal((0, 0, 2), major_axis=(1, 0, 0), symmetry=np.pi)
    CanonicalNormal((0, 0, 1), major axis (1, 0, 0), symmetry 180 deg)
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
                    f"a major axis is perpendicular to its normal; {major.tolist()} and {direction.tolist()} "
                    f"are {np.degrees(np.arccos(np.clip(major @ direction, -1, 1))):.1f} deg apart, not 90"
                )
            object.__setattr__(self, "major_axis", major)

    def __repr__(self) -> str:
        roll = "any roll"
        if self.major_axis is not None:
            roll = f"major axis {_rounded(self.major_axis)}, symmetry {np.degrees(self.symmetry):.3g} deg"
        return f"{type(self).__name__}({_rounded(self.direction)}, {roll})"


@checked
@dataclass(frozen=True, eq=False)
class AcceptedNormal(CanonicalNormal):
    """Canonical normal by which the viewpoint of an object as placed is judged, in the world frame.

    Parameters
    ----------
    direction, major_axis, symmetry
        As in :class:`CanonicalNormal`, in the world frame.
    circle_axis
        Vector, shape (3,), or None; normalized. Every direction perpendicular to it is accepted: the circle about a
        lying can, of which ``direction`` is the member nearest the vertical.

    Examples
    --------
    >>> normal = AcceptedNormal((0, 0, 1))
    >>> round(np.degrees(normal.angle((0, 1, 1))))
    45
    """

    circle_axis: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.circle_axis is not None:
            object.__setattr__(self, "circle_axis", unit_vector(self.circle_axis, "a circle's axis"))

    def __repr__(self) -> str:
        if self.circle_axis is None:
            return super().__repr__()
        return f"{super().__repr__()[:-1]}, circle about {_rounded(self.circle_axis)})"

    def rotated(self, rotation: Rotation) -> AcceptedNormal:
        """Accepted normal after the object has been rotated.

        Parameters
        ----------
        rotation
            Rotation of the object, world frame.
        """
        matrix = rotation.as_matrix()  # SciPy's `apply` refuses read-only vectors
        major, circle = (None if v is None else matrix @ v for v in (self.major_axis, self.circle_axis))
        return AcceptedNormal(matrix @ self.direction, major, self.symmetry, circle)

    def nearest(self, direction: ArrayLike) -> NDArray[np.float64]:
        """Accepted unit vector nearest to a direction, shape (3,), world frame.

        It is ``self.direction`` unless a whole circle is accepted, and also for a direction along that circle's axis,
        from which all members are equally far.

        Parameters
        ----------
        direction
            Direction from the object to the camera, shape (3,), world frame.
        """
        if self.circle_axis is None:
            return self.direction
        d = unit_vector(direction, "a viewing direction")
        across = d - (d @ self.circle_axis) * self.circle_axis
        norm = np.linalg.norm(across)
        return self.direction if norm < 1e-9 else across / norm

    def angle(self, direction: ArrayLike) -> float:
        """Angle between a direction and the accepted normal, rad, in [0, pi].

        For the reversed optical axis, this is the viewpoint error (errata 16).

        Parameters
        ----------
        direction
            Direction from the object to the camera, shape (3,), world frame.
        """
        d, n = unit_vector(direction, "a viewing direction"), self.nearest(direction)
        # Unlike the arc cosine, exact for small angles.
        return float(np.arctan2(np.linalg.norm(np.cross(d, n)), d @ n))

    def view_angle(self, world_from_camera: RigidTransform) -> float:
        """Angle between a camera's reversed optical axis and the accepted normal, rad, in [0, pi].

        Parameters
        ----------
        world_from_camera
            Pose of the camera, optical frame.
        """
        return self.angle(-world_from_camera.rotation.apply([0.0, 0.0, 1.0]))

    def roll_error(self, world_from_camera: RigidTransform) -> float:
        """Roll that would align a camera's y axis with the projected major axis, rad, in (-symmetry/2, symmetry/2].

        Parameters
        ----------
        world_from_camera
            Pose of the camera, optical frame.

        Returns
        -------
        float
            Roll about the optical axis, positive from the camera's x toward its y axis, as ``rotate_wrist`` counts it.
            0 if any roll will do; NaN if the camera looks along the major axis, which then has no direction in the
            image.
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
    """True poses of object and camera, and the errors of the view, at the moment they are read.

    Parameters
    ----------
    data
        MuJoCo state of the scene.
    target_body, camera
        Ids of the target's body and of the camera in the model.
    normal
        Function that gives the accepted normal for a pose of the object; see ``ObjectSpec.accepted_normal``.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> cell = WorkCell("floating", "cuboid_1x2", seed=1)
    >>> 0 <= cell.truth.viewpoint_error() <= np.pi
    True
    """

    def __init__(
        self, data: mujoco.MjData, target_body: int, camera: int, normal: Callable[[RigidTransform], AcceptedNormal]
    ) -> None:
        for kind, i, count in (("body", target_body, data.model.nbody), ("camera", camera, data.model.ncam)):
            if not 0 <= i < count:
                raise InvalidParameterError(f"the model has no {kind} of id {i}; it has {count}, from 0")
        self._data, self._body, self._camera, self._normal = data, target_body, camera, normal

    def begin_episode(self) -> None:
        """Choose the accepted normal for the object as it stands now; the cell's ``reset`` calls this."""
        self._as_placed = self.world_from_object
        self._accepted = self._normal(self._as_placed)

    def __repr__(self) -> str:
        if not hasattr(self, "_accepted"):
            return "Truth(no episode)"
        view, roll = np.degrees((self.viewpoint_error(), self.roll_error()))
        return f"Truth(viewpoint error {view:.1f} deg, roll error {roll:.1f} deg)"

    @property
    def world_from_object(self) -> RigidTransform:
        """Current pose of the object."""
        rotation = Rotation.from_matrix(self._data.xmat[self._body].reshape(3, 3))
        return RigidTransform.from_components(self._data.xpos[self._body], rotation)

    @property
    def world_from_camera(self) -> RigidTransform:
        """Current pose of the camera, optical frame; what the arm believes is off by its encoders' errors."""
        return camera_pose(self._data, self._camera)

    @property
    def normal(self) -> AcceptedNormal:
        """Accepted normal, chosen for the object as it was placed and rotating with it since."""
        return self._accepted.rotated((self.world_from_object * self._as_placed.inv()).rotation)

    def viewpoint_error(self) -> float:
        """Angle between the reversed optical axis and the object's accepted normal, rad (Eq. 2.10; errata 16)."""
        return self.normal.view_angle(self.world_from_camera)

    def roll_error(self) -> float:
        """Roll that would align the camera's y axis with the major axis, rad: :meth:`AcceptedNormal.roll_error`."""
        return self.normal.roll_error(self.world_from_camera)


def unit_vector(vector: ArrayLike, what: str) -> NDArray[np.float64]:
    """Read-only unit vector along a vector of shape (3,), which ``what`` names in the error text."""
    array = np.array(vector, float)
    with np.errstate(over="ignore"):  # which ends as not finite
        norm = np.linalg.norm(array)
    if array.shape != (3,) or not np.isfinite(norm) or norm < 1e-12:
        raise InvalidParameterError(f"{what} is a finite vector of shape (3,), not zero; got {vector!r}")
    array /= norm
    array.flags.writeable = False
    return array


def _rounded(vector: NDArray[np.float64]) -> str:
    return "(" + ", ".join(f"{x:g}" for x in np.round(vector, 3) + 0.0) + ")"
