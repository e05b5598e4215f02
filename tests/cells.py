"""Cells that tests share: each is built once and reset before each use, which is far quicker than a new one."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any

from gvp_lib.simulation.arms import ArmSpec
from gvp_lib.simulation.objects import ObjectSpec
from gvp_lib.simulation.workcell import WorkCell


class Cells:
    """Cells by what they are made of. Call it for one at the beginning of the episode of a seed.

    Arms and objects of your own are told apart by their names.
    """

    def __init__(self) -> None:
        self._made: dict[tuple[object, ...], WorkCell] = {}

    def __call__(
        self,
        arm: str | ArmSpec = "baxter",
        target: str | ObjectSpec = "cuboid_1x2",
        placement: str = "flat",
        *,
        seed: int = 3,
        dynamic: bool = False,
        **options: Any,
    ) -> WorkCell:
        names = [each if isinstance(each, str) else each.name for each in (arm, target)]
        key = *names, placement, *((name, _key(options[name])) for name in sorted(options))
        if key not in self._made:
            self._made[key] = WorkCell(arm, target, placement, seed=seed, **options)
        cell = self._made[key]
        if arm != "floating":
            cell.dynamic = False
        cell.reset(seed)
        if dynamic:
            cell.dynamic = True
        return cell

    def close(self) -> None:
        """Free the graphics of all cells, some 100 MB each. They stay usable."""
        for cell in self._made.values():
            cell.close()


def _key(value: object) -> object:
    """A list's is its text; a noise is its own, for its text may leave parts out."""
    return value if isinstance(value, Hashable) else str(value)
