"""Which viewpoints are visited, and in what order. Thesis 2.4.2, 3.2, A.3, Figs. 2.5 and 2.6; errata 21."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.learning.recipe import CollectionRecipe

__all__ = ["redrawn", "tour", "viewpoints"]

_SCENE, _REDRAW = 1, 2  # streams of random numbers
_BLOCK = 1024


def viewpoints(recipe: CollectionRecipe, scene: int = 0) -> NDArray[np.float64]:
    """A scene's viewpoints in the order in which they are visited: tilt from the object's normal, azimuth about it, and
    roll, shape (n, 3), rad."""
    n = recipe.per_scene[scene]
    sphere = VirtualSphere(np.zeros(3), recipe.radius)
    if recipe.sampling == "uniform":
        drawn = _coordinates(sphere.uniform(n, recipe.max_tilt, recipe.rolls))
        drawn[:, 2] += recipe.roll_offset * 2 * np.pi / recipe.rolls
    else:
        rng = np.random.default_rng([recipe.seed, _SCENE, scene])
        drawn = _coordinates(sphere.random(n, rng, recipe.max_tilt, recipe.sigma))
    return drawn[tour(drawn)] if recipe.sort else drawn


def redrawn(recipe: CollectionRecipe, first: int, attempt: int, viewpoints: NDArray[np.float64]) -> NDArray[np.float64]:
    """What replaces viewpoints that the arm cannot take up: tilt, azimuth and roll, shape (n, 3), rad.

    The tilt is drawn anew from the same distribution, by the number of the first sample alone, so that it does not
    depend on who collects them. Azimuth and roll are kept: what an arm cannot reach lies mostly on one side, and a set
    with fewer views from there would have fewer labels that lead back from there.
    """
    rng = np.random.default_rng([recipe.seed, _REDRAW, first, attempt])
    sigma = recipe.sigma if recipe.sampling == "random" else None
    sphere = VirtualSphere(np.zeros(3), recipe.radius)
    tilt = _coordinates(sphere.random(len(viewpoints), rng, recipe.max_tilt, sigma))[:, 0]
    return np.column_stack([tilt, viewpoints[:, 1:]])


def tour(coordinates: NDArray[np.float64]) -> NDArray[np.int64]:
    """An order in which each viewpoint is followed by the nearest of those that are left, shape (n,).

    The thesis suggests to sort by the two angles of the point; this minds the roll too, which is what an arm's wrist
    takes longest for.

    Parameters
    ----------
    coordinates
        Tilt, azimuth and roll, shape (n, 3), rad. The tour begins at the one nearest to zero.
    """
    if len(coordinates) == 0:
        return np.zeros(0, np.int64)
    sphere = VirtualSphere(np.zeros(3), 1.0)
    blocks = np.split(coordinates, range(_BLOCK, len(coordinates), _BLOCK))
    quaternions = np.concatenate([sphere.viewpoint(*block.T).rotation.as_quat() for block in blocks])  # (n, 4)
    home = sphere.viewpoint(0.0, 0.0).rotation.as_quat()
    # Of unit quaternions the larger scalar product, in magnitude, is the smaller turn. What was visited is zeroed.
    left, order = quaternions.copy(), np.empty(len(coordinates), np.int64)
    here = int(np.argmax(np.abs(left @ home)))
    for k in range(len(order)):
        order[k] = here
        left[here] = 0.0
        here = int(np.argmax(np.abs(left @ quaternions[here])))
    return order


def _coordinates(poses: RigidTransform) -> NDArray[np.float64]:
    """Tilt, azimuth and roll of viewpoints about +z, shape (n, 3), rad."""
    level = VirtualSphere(np.zeros(3), 1.0)
    found = np.empty((len(poses), 3))
    for start in range(0, len(poses), _BLOCK):  # so that a large set takes no more memory than a small one
        some = poses[start : start + _BLOCK].rotation
        outward = -some.as_matrix()[:, :, 2]
        tilt = np.arctan2(np.hypot(outward[:, 0], outward[:, 1]), outward[:, 2])
        azimuth = np.arctan2(outward[:, 1], outward[:, 0])
        roll = (level.viewpoint(tilt, azimuth).rotation.inv() * some).as_rotvec()[:, 2]
        found[start : start + _BLOCK] = np.stack([tilt, azimuth, roll], axis=1)
    return found
