"""Labels of viewpoints: the best action, direction and angle to the normal, also in a turned picture. Thesis 2.4.2, Eq.
2.10; errata 16 to 18.

Labels need the object's true normal, which the thesis too knew while collecting data.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError
from gvp_lib.planning.plan import Action, axes_after
from gvp_lib.simulation.truth import AcceptedNormal

__all__ = ["TURNED_ACTIONS", "TURNS", "Label", "Labels", "best_actions", "label_view", "label_views", "turned"]

_ROUNDING = 1e-9  # rad: an improvement that is smaller is none, as on a lying can's circle


@dataclass(frozen=True, eq=False)
class Label:
    """Label of a viewpoint.

    Attributes
    ----------
    action
        Action with the largest reward; NO_OP where no move improves it.
    errors
        Angle to the accepted normal after each action, shape (5,), rad: the negative rewards of Eq. 2.10.
    direction
        Direction of the normal in the image, where to move the camera, rad, from +u toward +v in (-pi, pi].
    angle
        Angle to move, rad: the present viewpoint error.
    """

    action: Action
    errors: NDArray[np.float64]
    direction: float
    angle: float

    @property
    def margin(self) -> float:
        """Error of the second best action minus that of the best, rad: near 0 two labels all but tie."""
        best, second = np.sort(self.errors)[:2]
        return float(second - best)


def label_view(world_from_camera: RigidTransform, normal: AcceptedNormal, step: float = np.radians(5)) -> Label:
    """Label a viewpoint.

    Parameters
    ----------
    world_from_camera
        True pose of the camera.
    normal
        Accepted normal; of a lying can's circle, the nearest one to the pose.
    step
        Angle that an action moves over the sphere, rad.

    Examples
    --------
    >>> from gvp_lib import VirtualSphere
    >>> up = AcceptedNormal((0, 0, 1))
    >>> label = label_view(VirtualSphere((0, 0, 0), 0.5).viewpoint(np.radians(20), 0.0), up)
    >>> label.action.name, round(float(np.degrees(label.angle)), 3)
    ('UP', 20.0)
    """
    labels = label_views(RigidTransform.concatenate([world_from_camera]), normal, step)
    return Label(Action(int(labels.actions[0])), labels.errors[0], float(labels.directions[0]), float(labels.angles[0]))


@dataclass(frozen=True, eq=False)
class Labels:
    """Labels of n viewpoints, each as a :class:`Label`.

    Attributes
    ----------
    actions, directions, angles
        Shape (n,): numbers of :class:`Action`; rad.
    errors
        Shape (n, 5), rad.
    """

    actions: NDArray[np.int64]
    errors: NDArray[np.float64]
    directions: NDArray[np.float64]
    angles: NDArray[np.float64]


def label_views(world_from_camera: RigidTransform, normal: AcceptedNormal, step: float = np.radians(5)) -> Labels:
    """:func:`label_view` for n poses at once, which is far quicker."""
    if not 0 < step <= np.pi / 2:
        raise InvalidParameterError(f"a step is in radians, in (0, pi/2]; got {step}. For degrees: np.radians(...)")
    axes = world_from_camera.rotation.as_matrix()  # (n, 3, 3)
    outward = -axes_after(step) @ np.swapaxes(axes, 1, 2)  # (n, 5, 3), world frame
    back = -axes[:, :, 2]
    if normal.circle_axis is None:
        nearest = normal.direction
        along = outward @ nearest
        across = outward - along[..., None] * nearest
        errors = np.arctan2(np.sqrt((across * across).sum(axis=-1)), along)  # unlike the arc cosine, exact if small
    else:
        nearest = np.array([normal.nearest(b) for b in back])
        errors = np.abs(np.arcsin(np.clip(outward @ normal.circle_axis, -1.0, 1.0)))
    x, y, z = np.einsum("nij,ni->jn", axes, np.broadcast_to(nearest, back.shape))
    moves = errors[:, : Action.NO_OP]
    better = moves.min(axis=1) < errors[:, Action.NO_OP] - _ROUNDING
    actions = np.where(better, moves.argmin(axis=1), int(Action.NO_OP))
    return Labels(actions, errors, np.arctan2(y, x), np.arctan2(np.hypot(x, y), -z))


def best_actions(
    directions: NDArray[np.float64], angles: NDArray[np.float64], step: float = np.radians(5)
) -> NDArray[np.int64]:
    """Best actions for a step other than the one that a set was labeled for, shape (n,).

    Parameters
    ----------
    directions, angles
        As in :class:`Labels`, shape (n,), rad. For a lying can they lead to the normal nearest to each pose, although a
        step may bring another nearer.
    step
        Angle that an action moves over the sphere, rad.
    """
    normals = np.stack([np.sin(angles) * np.cos(directions), np.sin(angles) * np.sin(directions), -np.cos(angles)])
    rewards = -axes_after(step) @ normals  # (5, n), cosines of the errors
    moves = rewards[: Action.NO_OP]
    return np.where(moves.max(axis=0) > rewards[Action.NO_OP], moves.argmax(axis=0), int(Action.NO_OP))


# --- what becomes of a label where its picture is turned or mirrored --------------------------------------------------

_QUARTER, _MIRROR = np.array([[0, -1], [1, 0]]), np.array([[-1, 0], [0, 1]])

TURNS = tuple(
    np.linalg.matrix_power(_QUARTER, k) @ before for before in (np.eye(2, dtype=int), _MIRROR) for k in range(4)
)
"""The eight ways in which a square picture falls onto itself, four quarter turns and then four mirrorings: matrices
that act on (u, v), counted from the middle of the picture."""

_DIRECTIONS = np.array([action.direction for action in Action])  # (5, 2)

TURNED_ACTIONS = tuple(((_DIRECTIONS @ turn.T)[:, None] == _DIRECTIONS).all(axis=2).argmax(axis=1) for turn in TURNS)
"""For each turn, the action that each action becomes: int64 (5,)."""


def turned(pictures: NDArray[np.uint8], turn: NDArray[np.int64]) -> NDArray[np.uint8]:
    """View of square pictures (..., size, size, 3), turned by one of :data:`TURNS`."""
    if turn[0, 1]:  # u and v change places
        pictures = np.swapaxes(pictures, -3, -2)
    flips = turn.sum(axis=1)  # what becomes of the new u, and of the new v
    return pictures[..., :: flips[1], :: flips[0], :]
