"""Labels of viewpoints: best action, direction and angle to the normal, also in a rotated or mirrored picture. Thesis
2.4.2, Eq. 2.10; errata 16 to 18.

Labels need the object's true normal, which the thesis, too, knew while collecting data.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError
from gvp_lib.picture import count
from gvp_lib.planning.plan import Action, axes_after
from gvp_lib.simulation.truth import AcceptedNormal

__all__ = ["TURNED_ACTIONS", "TURNS", "Label", "Labels", "best_actions", "label_view", "label_views", "turned"]

_ROUNDING = 1e-9  # rad: a smaller improvement does not count, as on a lying can's circle


@dataclass(frozen=True, eq=False)
class Label:
    """Label of a viewpoint: the best action, and the way to the accepted normal.

    Attributes
    ----------
    action
        Action with the largest reward; NO_OP where no move increases it.
    errors
        Viewpoint error after each action, shape (5,), rad: the negative rewards of Eq. 2.10.
    direction
        Direction in the image in which to move the camera, rad, from +u toward +v, in (-pi, pi].
    angle
        Angle to move over the sphere, rad: the present viewpoint error.
    """

    action: Action
    errors: NDArray[np.float64]
    direction: float
    angle: float

    def __repr__(self) -> str:
        angle, direction, margin = np.degrees([self.angle, self.direction, self.margin])
        return (
            f"Label({self.action.name}, angle {angle:.1f} deg, direction {direction:.1f} deg, margin {margin:.1f} deg)"
        )

    @property
    def margin(self) -> float:
        """Error after the second best action minus that after the best, rad; near 0 the two labels all but tie."""
        best, second = np.sort(self.errors)[:2]
        return float(second - best)


@checked
def label_view(
    world_from_camera: RigidTransform, normal: AcceptedNormal | ArrayLike, step: float = np.radians(5)
) -> Label:
    """Label a viewpoint (Eq. 2.10).

    Parameters
    ----------
    world_from_camera
        True pose of the camera.
    normal
        Accepted normal, or its direction alone, shape (3,), world frame. Of a lying can's circle, the member nearest to
        the pose counts.
    step
        Angle that an action moves over the sphere, rad.

    Raises
    ------
    InvalidParameterError
        The step is not in (0, pi/2].

    Examples
    --------
    >>> from gvp_lib import VirtualSphere
    >>> world_from_camera = VirtualSphere((0, 0, 0), 0.5).viewpoint(np.radians(20), 0.0)
    >>> label_view(world_from_camera, AcceptedNormal((0, 0, 1)))
    Label(UP, angle 20.0 deg, direction -90.0 deg, margin 5.0 deg)
    """
    labels = label_views(world_from_camera, normal, step)
    return Label(Action(int(labels.actions[0])), labels.errors[0], float(labels.directions[0]), float(labels.angles[0]))


@dataclass(frozen=True, eq=False)
class Labels:
    """Labels of n viewpoints, as arrays of what a :class:`Label` holds.

    Attributes
    ----------
    actions
        Numbers of the best :class:`Action`, shape (n,).
    errors
        Viewpoint error after each action, shape (n, 5), rad.
    directions, angles
        Direction in the image and angle over the sphere, shape (n,), rad.
    """

    actions: NDArray[np.int64]
    errors: NDArray[np.float64]
    directions: NDArray[np.float64]
    angles: NDArray[np.float64]

    def __repr__(self) -> str:
        counts = ", ".join(f"{n} {action.name}" for action in Action if (n := np.sum(self.actions == action)))
        return f"Labels({count(len(self.actions), 'viewpoint')}: {counts})"


@checked(poses=True)
def label_views(
    world_from_camera: RigidTransform, normal: AcceptedNormal | ArrayLike, step: float = np.radians(5)
) -> Labels:
    """Label n viewpoints at once, which is much faster than one by one.

    Parameters
    ----------
    world_from_camera
        True poses of the camera, n in one transform.
    normal, step
        As in :func:`label_view`.

    Examples
    --------
    >>> from gvp_lib import VirtualSphere
    >>> poses = VirtualSphere((0, 0, 0), 0.5).viewpoint(np.radians([0, 10, 20]), 0.0)
    >>> label_views(poses, AcceptedNormal((0, 0, 1)))
    Labels(3 viewpoints: 2 UP, 1 NO_OP)
    """
    _check_step(step)
    normal = normal if isinstance(normal, AcceptedNormal) else AcceptedNormal(np.asarray(normal, float))
    poses = RigidTransform.concatenate([world_from_camera]) if world_from_camera.single else world_from_camera
    axes = poses.rotation.as_matrix()  # (n, 3, 3)
    outward = -axes_after(step) @ np.swapaxes(axes, 1, 2)  # (n, 5, 3), world frame
    backward = -axes[:, :, 2]  # (n, 3)
    if normal.circle_axis is None:
        nearest = normal.direction
        along = outward @ nearest
        across = outward - along[..., None] * nearest
        errors = np.arctan2(np.sqrt((across * across).sum(axis=-1)), along)  # unlike the arc cosine, exact if small
    else:
        nearest = np.array([normal.nearest(axis) for axis in backward])
        errors = np.abs(np.arcsin(np.clip(outward @ normal.circle_axis, -1.0, 1.0)))
    x, y, z = np.einsum("nij,ni->jn", axes, np.broadcast_to(nearest, backward.shape))
    moves = errors[:, : Action.NO_OP]
    improves = moves.min(axis=1) < errors[:, Action.NO_OP] - _ROUNDING
    actions = np.where(improves, moves.argmin(axis=1), int(Action.NO_OP))
    return Labels(actions, errors, np.arctan2(y, x), np.arctan2(np.hypot(x, y), -z))


def _check_step(step: float) -> None:
    if not 0 < step <= np.pi / 2:
        raise InvalidParameterError(f"a step is in radians, in (0, pi/2]; got {step}. For degrees: np.radians(...)")


@checked
def best_actions(
    directions: NDArray[np.float64], angles: NDArray[np.float64], step: float = np.radians(5)
) -> NDArray[np.int64]:
    """Best actions for a step other than the one that a data set was labeled for, shape (n,).

    Parameters
    ----------
    directions, angles
        Direction in the image and angle over the sphere to the normal, shape (n,), rad. For a lying can they lead to
        the normal nearest to each pose, although a step may bring another nearer.
    step
        Angle that an action moves over the sphere, rad.

    Examples
    --------
    >>> best_actions(np.zeros(2), np.radians([2.0, 4.0]), step=np.radians(5)).tolist()  # NO_OP, RIGHT
    [4, 3]
    """
    _check_step(step)
    directions, angles = np.asarray(directions), np.asarray(angles)
    if directions.ndim != 1 or directions.shape != angles.shape:
        raise InvalidParameterError(
            f"directions and angles are of the same n viewpoints, shape (n,); got {directions.shape} and {angles.shape}"
        )
    normals = np.stack([np.sin(angles) * np.cos(directions), np.sin(angles) * np.sin(directions), -np.cos(angles)])
    rewards = -axes_after(step) @ normals  # (5, n), cosines of the errors
    moves = rewards[: Action.NO_OP]
    return np.where(moves.max(axis=0) > rewards[Action.NO_OP], moves.argmax(axis=0), int(Action.NO_OP))


# --- labels of rotated and mirrored pictures --------------------------------------------------------------------------

_QUARTER, _MIRROR = np.array([[0, -1], [1, 0]]), np.array([[-1, 0], [0, 1]])

TURNS = tuple(
    np.linalg.matrix_power(_QUARTER, k) @ before for before in (np.eye(2, dtype=int), _MIRROR) for k in range(4)
)
"""The eight symmetries of a square picture, four rotations by quarter turns and then four reflections: matrices (2, 2)
that act on (u, v), measured from the middle of the picture."""

_DIRECTIONS = np.array([action.direction for action in Action])  # (5, 2)

TURNED_ACTIONS = tuple(((_DIRECTIONS @ turn.T)[:, None] == _DIRECTIONS).all(axis=2).argmax(axis=1) for turn in TURNS)
"""Action that each action becomes under each of :data:`TURNS`: int64 (5,)."""


@checked
def turned(pictures: NDArray[np.uint8], turn: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Rotate or mirror square pictures; a view of them, not a copy.

    Parameters
    ----------
    pictures
        Square pictures, shape (..., size, size, 3).
    turn
        One of :data:`TURNS`.

    Examples
    --------
    >>> picture = np.repeat(np.array([[1, 2], [3, 4]], np.uint8)[..., None], 3, axis=2)
    >>> turned(picture, TURNS[1])[..., 0].tolist()  # a quarter turn, clockwise
    [[3, 1], [4, 2]]
    """
    pictures, turn = np.asarray(pictures), np.asarray(turn)
    square = np.ndim(pictures) >= 3 and np.shape(pictures)[-3] == np.shape(pictures)[-2]
    if not square or turn.shape != (2, 2) or not np.array_equal(turn @ turn.T, np.eye(2)):
        raise InvalidParameterError(
            "square pictures, (..., size, size, 3), are turned by one of TURNS, such as TURNS[1]; got the shape "
            f"{np.shape(pictures)} and {turn.tolist()}"
        )
    if turn[0, 1]:  # u and v change places
        pictures = np.swapaxes(pictures, -3, -2)
    flips = turn.sum(axis=1)  # direction, +1 or -1, in which to read the new u and the new v
    return pictures[..., :: flips[1], :: flips[0], :]
