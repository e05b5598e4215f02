"""Other objects beside the one to grasp, so that a camera sees several."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gvp_lib.simulation.object_model import ObjectSpec
from gvp_lib.simulation.placements import Placed, place

__all__ = ["place_beside"]

_RING, _GAP = 0.13, 0.02  # m: least distance from the target, and least room between any two


def place_beside(
    others: Sequence[ObjectSpec], target: ObjectSpec, placed: Placed, rng: np.random.Generator, table_height: float
) -> list[Placed]:
    """Stand objects flat on the table, in a ring about a placed target, clear of it and of each other.

    Parameters
    ----------
    others
        The objects; they stand at even angles from a random one.
    target, placed
        The object in the middle, and where it stands.
    table_height
        Height of the table's top, meters, world frame.
    """
    start, middle, count = rng.uniform(0, 2 * np.pi), placed.world_from_object.translation[:2], len(others)
    angles = start + np.arange(count) * (2 * np.pi / max(1, count))
    # Their yaws are not drawn yet, so each is given the circle about its bounding box.
    sizes = [float(np.linalg.norm(spec.bounding_box().half_extents[:2])) for spec in others]
    ring = max([_RING, *(placed.reach(target) + size + _GAP for size in sizes)])
    if count > 1:
        ring = max(ring, (max(sizes) + 0.5 * _GAP) / np.sin(np.pi / count))
    return [
        place(spec, "flat", rng, middle + ring * np.array([np.cos(a), np.sin(a)]), table_height)
        for spec, a in zip(others, angles, strict=True)
    ]
