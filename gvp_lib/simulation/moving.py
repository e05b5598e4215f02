"""Moving targets for closed-loop control (thesis 2.4), a record of contacts, and a shake test."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import checked, finite
from gvp_lib.errors import InvalidParameterError
from gvp_lib.simulation.scene import TARGET
from gvp_lib.simulation.workcell import WorkCell

__all__ = ["ContactRecord", "Path", "Rocking", "Sliding", "Turning", "moving_target", "record_contacts", "shake"]

_SAMPLE_EVERY = 4  # steps of a millisecond

Path = Callable[[float], RigidTransform]
"""Motion of an object as a function of time in s: a translation along the world's axes, m, and a rotation about the
object's origin."""


@checked
@dataclass(frozen=True, slots=True)
class Sliding:
    """Motion over the table at a constant velocity.

    Parameters
    ----------
    velocity
        Velocity (x, y), m/s, world frame.

    Examples
    --------
    >>> Sliding((0.02, 0.0))(3.0).translation.tolist()
    [0.06, 0.0, 0.0]
    """

    velocity: tuple[float, float]

    def __post_init__(self) -> None:
        if not np.isfinite(self.velocity).all():
            raise InvalidParameterError(f"a sliding object's velocity is (x, y) in m/s, finite; got {self.velocity}")

    def __call__(self, seconds: float) -> RigidTransform:
        """Motion after a time in s."""
        finite(seconds=seconds)
        vx, vy = self.velocity
        return RigidTransform.from_translation([vx * seconds, vy * seconds, 0.0])


@checked
@dataclass(frozen=True, slots=True)
class Turning:
    """Rotation about the vertical at a constant rate.

    Parameters
    ----------
    rate
        Angular velocity, rad/s, positive from the world's x toward its y axis.

    Examples
    --------
    >>> Turning(np.radians(15))(2.0).rotation.as_rotvec(degrees=True).round(6).tolist()
    [0.0, 0.0, 30.0]
    """

    rate: float

    def __post_init__(self) -> None:
        if not np.isfinite(self.rate):
            raise InvalidParameterError(f"a turning object's rate is in rad/s, finite; got {self.rate}")

    def __call__(self, seconds: float) -> RigidTransform:
        """Motion after a time in s."""
        finite(seconds=seconds)
        return RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, self.rate * seconds]))


@checked
@dataclass(frozen=True, slots=True)
class Rocking:
    """Rocking about a horizontal axis, to both sides of level.

    Parameters
    ----------
    amplitude
        Largest tilt, rad.
    period
        Time of one swing back and forth, s, positive.
    azimuth
        Direction of the axis, rad, from the world's x toward its y axis.

    Examples
    --------
    >>> Rocking(np.radians(10), period=4.0)(1.0).rotation.as_rotvec(degrees=True).round(6).tolist()
    [10.0, 0.0, 0.0]
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
        """Motion after a time in s."""
        finite(seconds=seconds)
        angle = self.amplitude * np.sin(2 * np.pi * seconds / self.period)
        axis = np.array([np.cos(self.azimuth), np.sin(self.azimuth), 0.0])
        return RigidTransform.from_rotation(Rotation.from_rotvec(angle * axis))


@checked
@contextmanager
def moving_target(cell: WorkCell, path: Path) -> Iterator[None]:
    """Context in which the target, and ``cell.truth`` with it, moves along a path as simulated time passes.

    Time passes while the arm moves and in ``cell.wait(seconds)``, but not while a picture is taken. A closed loop that
    may command no motion should therefore wait for as long as a picture and its policy would take. Nothing is pushed:
    the object is where the path puts it, raised or lowered so that its bounding box stays as high above the table as
    before.

    Parameters
    ----------
    cell
        Cell in the kinematic mode, with its episode set up: the path starts where the object now stands. After
        ``cell.reset``, enter a new context.
    path
        :class:`Sliding`, :class:`Turning`, :class:`Rocking`, or any function of time; see :data:`Path`.

    Raises
    ------
    InvalidParameterError
        The cell is in the dynamic mode, or was reset in this context.

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
            "a target moves along a path in the kinematic mode only, since in the dynamic mode it obeys physics; "
            "set cell.dynamic = False"
        )
    model, data, began, start = cell.model, cell.data, cell.time, cell.truth.world_from_object
    box = cell.target_spec.bounding_box()
    at, latest = model.joint(TARGET).qposadr[0], began

    def lowest(rotation: Rotation) -> float:
        """Height of the box's lowest point over the target's origin, m."""
        up = rotation.as_matrix()[2]
        return float(up @ box.center - np.abs(up) @ box.half_extents)

    def update_pose() -> None:
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

    with cell.watch(update_pose):
        yield


@dataclass
class ContactRecord:
    """Contacts of the fingers with the object during a grasp, summed up.

    Attributes
    ----------
    deepest
        Largest penetration of a finger into the object, m; 0 if only the skin of a pad was pressed.
    fastest
        Largest speed of the object's center, m/s, downward motion left out: dropped from the height of a lift, an
        object reaches 1.4 m/s without any contact.
    touches
        Number of samples, 4 ms apart, in which a finger pressed on the object.
    """

    deepest: float = 0.0
    fastest: float = 0.0
    touches: int = 0


@checked
@contextmanager
def record_contacts(cell: WorkCell) -> Iterator[ContactRecord]:
    """Context in which contacts between fingers and object are recorded; dynamic mode only.

    Parameters
    ----------
    cell
        Work cell in the dynamic mode.

    Yields
    ------
    ContactRecord
        Record, updated as simulated time passes.

    Examples
    --------
    >>> cell = WorkCell("baxter", dynamic=True)
    >>> with record_contacts(cell) as contacts:
    ...     cell.wait(0.01)
    >>> contacts.touches
    0
    """
    model, data, record = cell.model, cell.data, ContactRecord()
    target = cell.target_body
    of_finger = np.isin(np.arange(model.ngeom), list(cell.finger_geoms))  # tables: a search would cost more than a step
    of_target = model.geom_bodyid == target
    velocity, steps = model.body_dofadr[target], 0

    def sample() -> None:
        """Look at the contacts of every few steps."""
        nonlocal steps
        steps += 1
        if steps % _SAMPLE_EVERY:
            return
        x, y, z = data.qvel[velocity : velocity + 3]
        record.fastest = max(record.fastest, float(np.sqrt(x * x + y * y + max(z, 0.0) ** 2)))
        if data.ncon:
            geoms, distances = data.contact.geom, data.contact.dist
            between = of_finger[geoms].any(axis=1) & of_target[geoms].any(axis=1)
            record.deepest = max(record.deepest, float(-distances[between].min(initial=0.0)))
            record.touches += bool((between & (distances < data.contact.includemargin)).any())

    with cell.watch(sample, every_step=True):
        yield record


@checked
def shake(cell: WorkCell, acceleration: float = 5.0, seconds: float = 0.2) -> None:
    """Accelerate the held object along each axis, back and forth, as if the hand had moved; dynamic mode only.

    Gravity changes instead, which is the same to the object; the arm carries its own weight at any gravity.

    Parameters
    ----------
    cell
        Work cell with an object in its hand.
    acceleration
        Acceleration in each of the six directions, m/s^2.
    seconds
        Time in each direction, s.

    Examples
    --------
    >>> cell = WorkCell("baxter", dynamic=True)
    >>> shake(cell, seconds=0.005)
    >>> round(cell.time, 3)
    0.03
    """
    finite(acceleration=acceleration)
    at_rest = cell.model.opt.gravity.copy()
    try:
        for direction in (*np.eye(3), *-np.eye(3)):
            cell.model.opt.gravity[:] = at_rest + acceleration * direction
            cell.wait(seconds)
    finally:
        cell.model.opt.gravity[:] = at_rest
