"""The five actions of the learned viewpoint planner. Thesis 2.4, Action Space; errata 16 to 18."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError

__all__ = ["Action", "axes_after"]


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
        if not (0 <= angle <= np.pi and radius > 0):
            raise InvalidParameterError(
                f"a step is an angle in rad, at most pi, on a sphere of positive radius in m; got {angle}, {radius}"
            )
        du, dv = self.direction
        rotation = Rotation.from_rotvec(angle * np.array([dv, -du, 0.0]))
        center = np.array([0.0, 0.0, radius])
        return RigidTransform.from_components(center - rotation.apply(center), rotation)


_DIRECTIONS = {
    Action.UP: (0, -1),
    Action.LEFT: (-1, 0),
    Action.DOWN: (0, 1),
    Action.RIGHT: (1, 0),
    Action.NO_OP: (0, 0),
}


def axes_after(angle: float) -> NDArray[np.float64]:
    """The optical axis after each action by an angle, rad, in the camera's present frame, shape (5, 3)."""
    moves = np.array([action.direction for action in Action], float)
    still = 1.0 - np.abs(moves).sum(axis=1)
    return np.column_stack([-np.sin(angle) * moves, np.cos(angle) * (1 - still) + still])
