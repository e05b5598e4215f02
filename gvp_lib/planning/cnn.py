"""What a policy of the learned viewpoint planner may say: one of five actions, or a tilt. Thesis 2.4, Action Space;
errata 16 to 18."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError

__all__ = ["Action", "Tilt", "axes_after"]


class Action(IntEnum):
    """What the learned planner may do: a step over the virtual sphere in a direction of the image, or none.

    The directions are the image's as the camera is rolled: UP moves the camera along its own -y, so that what it sees
    tips the way it would if the eye climbed.

    Examples
    --------
    >>> Action.DOWN.direction
    (0, 1)
    >>> Action(4).name
    'NO_OP'
    """

    UP = 0
    LEFT = 1
    DOWN = 2
    RIGHT = 3
    NO_OP = 4

    @property
    def direction(self) -> tuple[int, int]:
        """Where the camera moves in the image, (u, v): one of -1, 0, 1 each."""
        return _DIRECTIONS[self]

    def step(self, angle: float, radius: float) -> RigidTransform:
        """The motion over the sphere as ``camera_from_target``, which :meth:`EyeInHandArm.move_camera` takes.

        Parameters
        ----------
        angle
            Between the two viewpoints, seen from the center, rad.
        radius
            Of the sphere, m; the center stays where it is in the picture.
        """
        return _over_sphere(self.direction, angle, radius)


_DIRECTIONS = {
    Action.UP: (0, -1),
    Action.LEFT: (-1, 0),
    Action.DOWN: (0, 1),
    Action.RIGHT: (1, 0),
    Action.NO_OP: (0, 0),
}


@dataclass(frozen=True, slots=True)
class Tilt:
    """How far, and which way, the camera has yet to move over the sphere: what a policy says that does regression.

    The camera moves by the angle ``hypot(u, v)`` in the image's direction ``atan2(v, u)``, as ``Label.angle`` and
    ``Label.direction`` count them (:mod:`gvp_lib.learning.labels`); then it looks along the object's normal.

    Attributes
    ----------
    u, v
        The angle's parts along the image's u and v, rad.
    sigma
        Standard deviation of each part, rad, positive; ``inf`` where the policy has no idea.

    Examples
    --------
    >>> tilt = Tilt(0.0, np.radians(20), sigma=np.radians(2))
    >>> round(float(np.degrees(tilt.angle)), 6)
    20.0
    >>> np.allclose(tilt.step(0.5, most=np.radians(5)).as_matrix(), Action.DOWN.step(np.radians(5), 0.5).as_matrix())
    True
    """

    u: float
    v: float
    sigma: float

    def __post_init__(self) -> None:
        for name in ("u", "v", "sigma"):  # as a network gives them they may be scalars of any library
            object.__setattr__(self, name, float(getattr(self, name)))
        # The parts of an angle of pi may come to the last bits more than pi.
        if not (np.hypot(self.u, self.v) <= np.pi * (1 + 1e-12) and self.sigma > 0):
            raise InvalidParameterError(
                "a tilt is two parts of an angle in rad, at most pi together, and their standard deviation in rad, "
                f"positive, or inf where nothing is known; got u={self.u}, v={self.v}, sigma={self.sigma}"
            )

    @classmethod
    def toward(cls, normal: ArrayLike, sigma: float) -> Tilt:
        """The tilt after which the camera looks along ``-normal``: a vector in its present frame, shape (3,)."""
        x, y, z = np.asarray(normal, float)
        angle, direction = np.arctan2(np.hypot(x, y), -z), np.arctan2(y, x)
        return cls(float(angle * np.cos(direction)), float(angle * np.sin(direction)), sigma)

    @property
    def angle(self) -> float:
        """How far to move, rad, in [0, pi]."""
        return min(float(np.hypot(self.u, self.v)), np.pi)

    @property
    def direction(self) -> float:
        """Which way in the image, rad, from +u toward +v in (-pi, pi]."""
        return float(np.arctan2(self.v, self.u))

    @property
    def normal(self) -> NDArray[np.float64]:
        """The object's normal that this speaks of: a unit vector in the camera's present frame, shape (3,)."""
        across = np.sin(self.angle)
        return np.array([across * np.cos(self.direction), across * np.sin(self.direction), -np.cos(self.angle)])

    def step(self, radius: float, most: float = np.pi) -> RigidTransform:
        """The motion over the sphere as ``camera_from_target``, as :meth:`Action.step`.

        Parameters
        ----------
        radius
            Of the sphere, m.
        most
            The farthest to move, rad.
        """
        return _over_sphere((np.cos(self.direction), np.sin(self.direction)), min(self.angle, most), radius)


def _over_sphere(direction: tuple[float, float], angle: float, radius: float) -> RigidTransform:
    """Move by an angle, rad, about the point ``radius`` m ahead, setting out in a unit direction (u, v) of the image,
    or nowhere in (0, 0)."""
    if not (0 <= angle <= np.pi and 0 < radius < np.inf):
        raise InvalidParameterError(
            f"a step is an angle in rad, at most pi, on a sphere of positive radius in m; got {angle}, {radius}"
        )
    du, dv = direction
    rotation = Rotation.from_rotvec(angle * np.array([dv, -du, 0.0]))
    center = np.array([0.0, 0.0, radius])
    return RigidTransform.from_components(center - rotation.apply(center), rotation)


def axes_after(angle: float) -> NDArray[np.float64]:
    """The optical axis after each action by an angle, rad, in the camera's present frame, shape (5, 3)."""
    moves = np.array([action.direction for action in Action], float)
    still = 1.0 - np.abs(moves).sum(axis=1)
    return np.column_stack([-np.sin(angle) * moves, np.cos(angle) * (1 - still) + still])
