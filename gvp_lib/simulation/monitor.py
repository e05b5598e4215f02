"""Trials of a grasp, for judges: how deep fingers sank in, how fast the object flew, whether it survives a shake."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from gvp_lib.simulation.workcell import WorkCell

__all__ = ["ContactRecord", "record_contacts", "shake"]

_EVERY = 4  # steps of a millisecond


@dataclass
class ContactRecord:
    """The extremes of what a cell's physics did.

    Attributes
    ----------
    deepest
        Largest overlap of a finger with the object, m; 0 where one only pressed on the skin of a pad.
    fastest
        Largest speed of the object's center, its fall left out, m/s: a dropped object falls at 1.4 m/s from the height
        of a lift, and no contact is to blame.
    touches
        Looks in which a finger pressed on the object.
    """

    deepest: float = 0.0
    fastest: float = 0.0
    touches: int = 0


@contextmanager
def record_contacts(cell: WorkCell) -> Iterator[ContactRecord]:
    """While in this context, record what contacts do in a cell's dynamic mode."""
    model, data, record = cell.model, cell.data, ContactRecord()
    target = cell.target_body
    of_finger = np.isin(np.arange(model.ngeom), list(cell.finger_geoms))  # tables: a search would cost more than a step
    of_target = model.geom_bodyid == target
    velocity, steps = model.body_dofadr[target], 0

    def look() -> None:
        """After every step; it reads one in four."""
        nonlocal steps
        steps += 1
        if steps % _EVERY:
            return
        x, y, z = data.qvel[velocity : velocity + 3]
        record.fastest = max(record.fastest, float(np.sqrt(x * x + y * y + max(z, 0.0) ** 2)))
        if data.ncon:
            geoms, distances = data.contact.geom, data.contact.dist
            between = of_finger[geoms].any(axis=1) & of_target[geoms].any(axis=1)
            record.deepest = max(record.deepest, float(-distances[between].min(initial=0.0)))
            record.touches += bool((between & (distances < data.contact.includemargin)).any())

    with cell.watch(look, every_step=True):
        yield record


def shake(cell: WorkCell, acceleration: float = 5.0, seconds: float = 0.2) -> None:
    """Jerk what the hand holds along each axis, forth and back, as a hand would that moved so; dynamic mode only.

    It is gravity that changes, which to the object is the same; the arm carries its own weight at any gravity.

    Parameters
    ----------
    cell
        A work cell with something in its hand.
    acceleration
        In each of the six directions, m/s^2.
    seconds
        Of each of them.
    """
    at_rest = cell.model.opt.gravity.copy()
    try:
        for direction in (*np.eye(3), *-np.eye(3)):
            cell.model.opt.gravity[:] = at_rest + acceleration * direction
            cell.wait(seconds)
    finally:
        cell.model.opt.gravity[:] = at_rest
