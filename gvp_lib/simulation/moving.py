"""What happens to the target while time goes on: it moves by itself, which a closed loop is for (thesis 2.4), it is
shaken in the hand, and fingers press on it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError
from gvp_lib.simulation.scene import TARGET
from gvp_lib.simulation.workcell import WorkCell

__all__ = ["ContactRecord", "Path", "Rocking", "Sliding", "Turning", "moving_target", "record_contacts", "shake"]

_LOOK_EVERY = 4  # steps of a millisecond

Path = Callable[[float], RigidTransform]
"""Motion of an object after so many seconds: a shift in the world's axes, m, and a turn about its own origin."""


@dataclass(frozen=True, slots=True)
class Sliding:
    """Motion over the table at a constant velocity ``(x, y)``, world frame, m/s."""

    velocity: tuple[float, float]

    def __post_init__(self) -> None:
        if not np.isfinite(self.velocity).all():
            raise InvalidParameterError(f"a sliding object's velocity is (x, y) in m/s, finite; got {self.velocity}")

    def __call__(self, seconds: float) -> RigidTransform:
        """The motion after so many seconds."""
        vx, vy = self.velocity
        return RigidTransform.from_translation([vx * seconds, vy * seconds, 0.0])


@dataclass(frozen=True, slots=True)
class Turning:
    """Turn about the vertical at a constant rate, rad/s, positive from the world's x toward its y."""

    rate: float

    def __post_init__(self) -> None:
        if not np.isfinite(self.rate):
            raise InvalidParameterError(f"a turning object's rate is in rad/s, finite; got {self.rate}")

    def __call__(self, seconds: float) -> RigidTransform:
        """The motion after so many seconds."""
        return RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, self.rate * seconds]))


@dataclass(frozen=True, slots=True)
class Rocking:
    """Rocking about a horizontal axis, to ``amplitude`` on either side of level.

    Attributes
    ----------
    amplitude
        Largest tilt, rad.
    period
        Time of one swing back and forth, s, positive.
    azimuth
        Direction of the axis, rad from the world's x toward its y.
    """

    amplitude: float
    period: float
    azimuth: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite((self.amplitude, self.period, self.azimuth)).all() and self.period > 0):
            raise InvalidParameterError(
                "a rocking object's amplitude, period and azimuth are in rad, s and rad, finite, and the period is "
                f"positive; got {self.amplitude}, {self.period} and {self.azimuth}"
            )

    def __call__(self, seconds: float) -> RigidTransform:
        """The motion after so many seconds."""
        angle = self.amplitude * np.sin(2 * np.pi * seconds / self.period)
        axis = np.array([np.cos(self.azimuth), np.sin(self.azimuth), 0.0])
        return RigidTransform.from_rotation(Rotation.from_rotvec(angle * axis))


@contextmanager
def moving_target(cell: WorkCell, path: Path) -> Iterator[None]:
    """Move the target along a path as simulated time passes, and ``cell.truth`` with it, while in this context.

    Time passes while the arm moves and in ``cell.wait(seconds)``; a picture takes none. A loop around a planner that
    may stay where it is should therefore wait for as long as a look and the policy take. Nothing is pushed: the object
    is where the path has it, lifted or lowered so that its bounding box stays as high above the table as before.

    Parameters
    ----------
    cell
        Cell in the kinematic mode, its episode set up: the path begins where the object now stands. After
        ``cell.reset`` enter anew.
    path
        :class:`Sliding`, :class:`Turning`, :class:`Rocking`, or any function from seconds to the motion until then.

    Examples
    --------
    >>> cell = WorkCell(arm="floating", target="cuboid_1x2", seed=1)
    >>> before = cell.truth.world_from_object.translation
    >>> with moving_target(cell, Sliding((0.02, 0.0))):
    ...     cell.wait(3.0)
    >>> (cell.truth.world_from_object.translation - before).round(6).tolist()
    [0.06, 0.0, 0.0]
    """
    if cell.dynamic:
        raise InvalidParameterError(
            "a target moves along a path in the kinematic mode only, since in the other it obeys physics; "
            "set cell.dynamic = False"
        )
    model, data, began, start = cell.model, cell.data, cell.time, cell.truth.world_from_object
    box = cell.target_spec.bounding_box()
    at, latest = model.joint(TARGET).qposadr[0], began

    def lowest(rotation: Rotation) -> float:
        """Height of the box's lowest point over the target's origin, m."""
        up = rotation.as_matrix()[2]
        return float(up @ box.center - np.abs(up) @ box.half_extents)

    def carry() -> None:
        """Put the target where the path has it now, resting on the table at any tilt."""
        nonlocal latest
        if cell.time < latest:
            raise InvalidParameterError("the cell was reset while its target moved; enter moving_target after reset")
        latest = cell.time
        motion = path(latest - began)
        rotation = motion.rotation * start.rotation
        lift = np.array([0.0, 0.0, lowest(start.rotation) - lowest(rotation)])
        data.qpos[at : at + 3] = start.translation + motion.translation + lift
        data.qpos[at + 3 : at + 7] = rotation.as_quat(scalar_first=True)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_camlight(model, data)

    with cell.watch(carry):
        yield


@dataclass
class ContactRecord:
    """Extremes of a grasp's contacts.

    Attributes
    ----------
    deepest
        Largest overlap of a finger with the object, m; 0 where one only pressed on the skin of a pad.
    fastest
        Largest speed of the object's center, its fall left out, m/s: a dropped object falls at 1.4 m/s from the height
        of a lift, and no contact is to blame.
    touches
        Number of looks in which a finger pressed on the object.
    """

    deepest: float = 0.0
    fastest: float = 0.0
    touches: int = 0


@contextmanager
def record_contacts(cell: WorkCell) -> Iterator[ContactRecord]:
    """Record the contacts of fingers and object, while in this context; dynamic mode only."""
    model, data, record = cell.model, cell.data, ContactRecord()
    target = cell.target_body
    of_finger = np.isin(np.arange(model.ngeom), list(cell.finger_geoms))  # tables: a search would cost more than a step
    of_target = model.geom_bodyid == target
    velocity, steps = model.body_dofadr[target], 0

    def look() -> None:
        nonlocal steps
        steps += 1
        if steps % _LOOK_EVERY:
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
    """Jerk the held object along each axis, back and forth, as if the hand had moved; dynamic mode only.

    Gravity changes instead, which to the object is the same; the arm carries its own weight at any gravity.

    Parameters
    ----------
    cell
        Work cell with something in its hand.
    acceleration, seconds
        Acceleration in each of the six directions, m/s^2, and how long it lasts.
    """
    at_rest = cell.model.opt.gravity.copy()
    try:
        for direction in (*np.eye(3), *-np.eye(3)):
            cell.model.opt.gravity[:] = at_rest + acceleration * direction
            cell.wait(seconds)
    finally:
        cell.model.opt.gravity[:] = at_rest
