"""Where the search for a solid begins: several rough boxes or cans, so that none of its valleys is missed."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gvp_lib.planning.least_squares import Model, Solids, Solution
from gvp_lib.planning.observations import Observations

__all__ = ["first_guesses", "guesses_with_top"]

_TILT = np.radians(35.0)
_TURNS = np.arange(8) * (np.pi / 4)  # of the axis about which to tilt
_HEIGHTS = (0.6, 1.5)  # of a box, over its shorter side as seen
_TOP = 0.004, 0.004  # m: inset and height of a top
_TOP_SCALES = (1.0, 5.0, 10.0)  # of a can's, which may be its shoulder or half of a tapered thing


def first_guesses(model: Model, seen: Observations) -> Solids:
    """Solids without a top, where the lines of sight meet, about as large as the middle view has it, tilted to all
    sides.

    From any one of them the search finds the best valley more often than not, so that of eight several do.
    """
    center = _meeting_point(seen)
    middle = len(seen.features) // 2
    facing = seen.rotation[middle] @ np.diag([1.0, -1.0, -1.0])  # z toward the camera, x to the right
    distance = float(np.linalg.norm(center - seen.position[middle]))
    sides = np.sqrt(12) * distance / seen.intrinsics.fx * seen.features[middle, [3, 5]]  # along u and v, m
    tilts = _TILT * np.stack([np.cos(_TURNS), np.sin(_TURNS), np.zeros(len(_TURNS))], axis=1)
    tilted = facing @ Rotation.from_rotvec(tilts).as_matrix()
    by_turns = itertools.cycle(_candidates(model, sides))
    axes, sizes = zip(*itertools.islice(by_turns, len(tilted)), strict=True)
    return Solids(tilted @ np.array(axes), np.repeat(center[None], len(tilted), axis=0), np.log(sizes))


def guesses_with_top(plain: Solution, model: Model) -> Solids:
    """The plain solid, with a top on each of its sides."""
    rotation, center = plain.solid.rotation[0], plain.solid.center[0]
    lengths = plain.model.sizes(plain.solid.log_sizes)[0, :3]
    ups = np.vstack([np.eye(3), -np.eye(3)]) if not model.shape.round else np.array([(0, 0, 1.0), (0, 0, -1.0)])
    rotations, sizes = [], []
    for up, scale in itertools.product(ups, _TOP_SCALES if model.shape.round else (1.0,)):
        k = int(np.argmax(np.abs(up)))
        # The axes in turn, so that the k-th becomes z: a proper rotation for either sign.
        order = [(k + 1) % 3, (k + 2) % 3, k]
        axes = rotation[:, order]
        if up[k] < 0:
            axes = axes @ np.diag([1.0, -1.0, -1.0])
        inset, top = np.multiply(_TOP, scale)
        body = lengths[order] - [0.0, 0.0, min(top, 0.4 * lengths[k])]
        rotations.append(axes)
        base = body[[0, 2]] if model.shape.round else body
        sizes.append([*base, inset, top])
    return Solids(np.array(rotations), np.repeat(center[None], len(rotations), axis=0), np.log(sizes))


def _candidates(model: Model, sides: NDArray[np.float64]) -> list[tuple[NDArray[np.float64], list[float]]]:
    """Two solids that look about as large: how they stand in the frame that faces the camera, and their sizes."""
    if not model.shape.round:
        return [(np.eye(3), [sides[0], sides[1], factor * min(sides)]) for factor in _HEIGHTS]
    lying = np.array([(1.0, 0, 0), (0, 0, 1.0), (0, -1.0, 0)]).T  # its axis along the image's v
    width = float(np.mean(sides))
    return [(np.eye(3), [width, 1.5 * width]), (lying, [sides[0], sides[1]])]


def _meeting_point(seen: Observations) -> NDArray[np.float64]:
    """The point nearest to all lines of sight through the centroids, shape (3,), m."""
    rays = np.einsum("nij,nj->ni", seen.rotation, seen.intrinsics.rays(seen.features[:, :2]))
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]  # (n, 3, 3)
    return np.linalg.solve(across.sum(0), np.einsum("nij,nj->i", across, seen.position))
