"""The eight ways in which a square picture falls onto itself, and what becomes of actions and tilts in it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gvp_lib.planning.learned import Action

__all__ = ["TURNED_ACTIONS", "TURNS", "turned"]

TURNS = tuple(
    np.array(turn).reshape(2, 2)
    for turn in (
        [1, 0, 0, 1], [0, -1, 1, 0], [-1, 0, 0, -1], [0, 1, -1, 0],
        [-1, 0, 0, 1], [0, -1, -1, 0], [1, 0, 0, -1], [0, 1, 1, 0],
    )
)  # fmt: skip
"""Four quarter turns, then four mirrorings: what (u, v) from the middle of the picture becomes, as a matrix."""

_DIRECTIONS = np.array([action.direction for action in Action])  # (5, 2)

TURNED_ACTIONS = tuple(((_DIRECTIONS @ turn.T)[:, None] == _DIRECTIONS).all(axis=2).argmax(axis=1) for turn in TURNS)
"""For each turn, what each action becomes: int64 (5,)."""


def turned(pictures: NDArray[np.uint8], turn: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Square pictures (..., size, size, 3), turned by one of :data:`TURNS`; a view of them."""
    if turn[0, 1]:  # u and v change places
        pictures = np.swapaxes(pictures, -3, -2)
    flips = turn.sum(axis=1)  # what becomes of the new u, and of the new v
    return pictures[..., :: flips[1], :: flips[0], :]
