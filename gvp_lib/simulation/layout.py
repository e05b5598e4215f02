"""Where the target and the objects beside it stand in an episode, by its seed alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gvp_lib.errors import InvalidParameterError, UnknownNameError
from gvp_lib.simulation.neighbors import place_beside
from gvp_lib.simulation.object_model import ObjectSpec
from gvp_lib.simulation.objects import object_spec
from gvp_lib.simulation.placements import PLACEMENTS, Placed, place
from gvp_lib.simulation.scene import Stage

__all__ = ["Layout", "seed_sequence"]


class Layout:
    """Draws where things stand.

    Parameters
    ----------
    target
        The object to grasp.
    placement
        How it stands: a name in ``PLACEMENTS``.
    others
        Objects that stand flat beside it.
    stage
        The table and its workspace.
    """

    def __init__(self, target: ObjectSpec, placement: str, others: Sequence[str | ObjectSpec], stage: Stage) -> None:
        if placement not in PLACEMENTS:
            raise UnknownNameError("placement", placement, PLACEMENTS)
        if isinstance(others, str):
            raise InvalidParameterError(f"others is a list of objects; for one, write others=[{others!r}]")
        self.target, self.placement, self.stage = target, placement, stage
        self.others = [object_spec(other) for other in others]
        self._last: tuple[object, Placed, list[Placed]] | None = None

    def at_rest(self, seed: np.random.SeedSequence) -> tuple[Placed, list[Placed]]:
        """Where the target and the others have come to rest. They do so in a simulation, which an episode that is
        repeated need not wait for again."""
        key = (tuple(np.atleast_1d(seed.entropy).tolist()), seed.spawn_key)  # type: ignore[arg-type]
        if self._last is None or self._last[0] != key:
            rng, height = np.random.default_rng(seed), self.stage.table_height
            (x0, x1), (y0, y1) = self.stage.workspace
            where = np.array([rng.uniform(x0, x1), rng.uniform(y0, y1)])
            placed = place(self.target, self.placement, rng, where, height)
            self._last = key, placed, place_beside(self.others, self.target, placed, rng, height)
        return self._last[1:]


def seed_sequence(seed: int | np.random.SeedSequence) -> np.random.SeedSequence:
    """A fresh sequence, whose children are the same every time."""
    if isinstance(seed, np.random.SeedSequence):
        return np.random.SeedSequence(seed.entropy, spawn_key=seed.spawn_key)
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise InvalidParameterError(f"a seed is a whole number, 0 or more, or a SeedSequence; got {seed!r}")
    return np.random.SeedSequence(int(seed))
