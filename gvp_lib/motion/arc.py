"""Traversal of an arc of the virtual sphere, centered on the object. Thesis 2.2, 2.3, Algorithm 2; errata 10 to 12."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arm import Motion, Outcome
from gvp_lib.motion.primitives import estimate_depth, range_to, toward_pixel
from gvp_lib.motion.sighting import Adjustment, Eye, View, center_on_object, ended
from gvp_lib.picture import Pictured, count

__all__ = ["Arc", "approach", "traverse_arc"]

Axis = Literal["x", "y"]
_FARTHEST = 0.5  # of the radius: a range that differs by more is a wrong measurement, or the sphere is not ours yet
_SIDEWAYS = (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)


@dataclass(frozen=True, eq=False)
class Arc(Pictured):
    """Views along an arc of the virtual sphere, or from all over it.

    Attributes
    ----------
    axis
        Camera's axis along which it moved, ``"x"`` or ``"y"``; None for views that lie along no arc, as those of
        :class:`gvp_lib.planning.SpreadViews`.
    views
        Views from the far end on the negative side of that axis to the far end on the positive side; without an axis in
        the order in which they were taken.
    center
        Index of the view where the traversal began; -1 where there is no view at all.
    ends
        Why it stopped on the negative side, and on the positive one.
    ranges
        Estimated distance to the object at each step (A.1), shape (n,), m; NaN at the center.
    """

    _figure = "plot_arc"

    axis: Axis | None
    views: tuple[View, ...]
    center: int
    ends: tuple[Outcome, Outcome]
    ranges: NDArray[np.float64]

    @classmethod
    @checked
    def of(cls, views: Sequence[View], center: int = 0) -> Arc:
        """Views from wherever they were taken, as estimators take them: an arc without an axis.

        Parameters
        ----------
        views
            Views of one object.
        center
            Number of the view from where the object's nearest face is looked for.
        """
        if not 0 <= center < max(1, len(views)):
            raise InvalidParameterError(f"the center is one of {len(views)} views, from 0; got {center}")
        return cls(None, tuple(views), center, (Outcome.REACHED, Outcome.REACHED), np.full(len(views), np.nan))

    def __len__(self) -> int:
        return len(self.views)

    def __repr__(self) -> str:
        if not self.views:
            return f"Arc({self.axis}, no views: {self.ends[0]})"
        if self.axis is None:
            return f"Arc({count(len(self), 'view')} up to {np.degrees(self.angles.max()):.0f} deg from the first)"
        low, high = np.degrees([self.angles[0], self.angles[-1]])
        ends = " and ".join(dict.fromkeys(self.ends))
        return f"Arc({self.axis}, {count(len(self), 'view')} from {low:.0f} to {high:.0f} deg, ended by {ends})"

    @cached_property
    def angles(self) -> NDArray[np.float64]:
        """Angle from the center to each view about the camera's other axis, as believed, shape (n,), rad, ascending.

        Without an axis, the angle between the two views, in their own order.
        """
        if not self.views:
            return np.empty(0)
        center_from_base = self.views[self.center].base_from_camera.rotation.inv()
        x, y, z = np.transpose([(center_from_base * v.base_from_camera.rotation).as_matrix()[:, 2] for v in self.views])
        if self.axis is None:
            return np.asarray(np.arctan2(np.hypot(x, y), z))
        # Moving along +y, the camera turns so as to look back along -y.
        return -np.arctan2(y if self.axis == "y" else x, z)

    @cached_property
    def ratios(self) -> NDArray[np.float64]:
        """Minor over major axis length in each view, shape (n,): R in 2.3."""
        return np.array([view.blob.ratio for view in self.views])


@checked
def approach(eye: Eye, radius: float, *, step: float = 0.02, tolerance: float = 0.05, attempts: int = 4) -> Adjustment:
    """Come to the radius from the object, centered on it, by depth from motion alone (2.2, Distance Adjustment).

    Each attempt steps sideways, to and fro in turn, estimates the range, and moves along the line of sight by what is
    missing. Where the arm cannot step one way it steps another.

    Parameters
    ----------
    eye
        Eye on the object.
    radius
        Distance to come to, m.
    step
        Length of a sidestep, m.
    tolerance
        Largest remaining distance, as a fraction of the radius.
    attempts
        Largest number of attempts.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> cell = WorkCell(arm="floating", target="cuboid_1x2", seed=1)
    >>> bool(approach(Eye(cell.arm, cell.segmenter), 0.25))
    True
    """
    _check_positive(radius=radius, step=step, tolerance=tolerance)
    centered, errors, arrived = center_on_object(eye), list[float](), False
    view, motion = centered.view, centered.motion
    for attempt in range(attempts):
        if view is None or not centered:
            break
        shift, motion = _sidestep(eye, view, step, attempt)
        looked, distance = _measured(eye, view, shift, radius) if motion else (view, np.nan)
        if looked is None or not motion:
            view = looked
            break
        known = bool(np.isfinite(distance))
        errors.append(distance - radius if known else np.nan)
        centered = _recenter(eye, looked, distance, errors[-1] if known else 0.0, 2.0)
        view, motion = centered.view, centered.motion
        arrived = bool(centered) and known and abs(errors[-1]) < tolerance * radius
        if arrived:
            break
    else:
        if centered:  # out of attempts, but near enough to go on from
            motion = Motion(True, Outcome.REACHED)
    outcome = ended(arrived, view, motion, Outcome.OUT_OF_STEPS if centered else Outcome.NOT_CENTERED)
    return Adjustment(outcome, view, np.array(errors), motion)


def _sidestep(eye: Eye, view: View, step: float, first: int) -> tuple[NDArray[np.float64], Motion]:
    """A step in the first direction of four that the arm can make, from where ``view`` was taken; how it went."""
    for turn in range(4):
        shift = step * np.array(_SIDEWAYS[(first + turn) % 4])
        motion = eye.arm.move_camera(RigidTransform.from_translation(shift))
        if motion or not eye.arm.move_joints(view.joints):
            break
    return shift, motion


@checked
def traverse_arc(
    eye: Eye,
    axis: Axis = "y",
    *,
    radius: float | None = 0.25,
    step: float = 0.020,
    max_angle: float = np.radians(60),
    threshold: float = 2.0,
    enough: Callable[[Sequence[View]], bool] | None = None,
) -> Arc:
    """Traverse an arc of the virtual sphere in both directions, looking at every step (Algorithm 2; errata 10, 11).

    The camera of ``eye`` must stand centered on the object. On each side, until a joint limit, a collision, a lost
    object or ``max_angle``:

    1. move ``step`` along the camera's axis,
    2. estimate the range from the shift of the centroid (A.1),
    3. recenter, and correct the range to the radius along the new line of sight,
    4. record joints, blob, and pose.

    Between the sides and at the end the arm returns to where it began.

    Parameters
    ----------
    eye
        Eye on the object.
    axis
        Camera's axis to move along, ``"y"`` or ``"x"``. With y on the object's major axis, ``"y"`` turns about the
        minor axis and ``"x"`` about the major one (errata 12).
    radius
        Radius of the sphere, m; None leaves the range alone, so that it grows with every tangential step.
    step
        Length of a step, m. Smaller is better and slower (3.1.6).
    max_angle
        Largest angle on each side, rad.
    threshold
        Largest offset after a centering, px.
    enough
        Function of all views so far, in the arc's order, called after each; true ends the traversal where the arm
        stands.

    Raises
    ------
    InvalidParameterError
        A length or an angle is not positive, or there is no such axis.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> cell = WorkCell(arm="floating", target="cuboid_1x2", seed=1)
    >>> eye = Eye(cell.arm, cell.segmenter)
    >>> _ = approach(eye, 0.25)
    >>> len(traverse_arc(eye, max_angle=np.radians(20))) > 6
    True
    """
    if axis not in ("x", "y"):
        raise InvalidParameterError(f'an arc goes along the camera\'s axis "x" or "y"; got {axis!r}')
    _check_positive(radius=radius, step=step, max_angle=max_angle, threshold=threshold)
    if max_angle > np.pi:
        raise InvalidParameterError(f"max_angle is in radians, at most pi; got {max_angle}. For degrees: np.radians(…)")
    start = eye.look()
    if start is None:
        return Arc(axis, (), -1, (Outcome.TARGET_LOST, Outcome.TARGET_LOST), np.empty(0))
    direction = np.array([0.0, 1.0, 0.0] if axis == "y" else [1.0, 0.0, 0.0])
    sides: dict[int, list[tuple[View, float]]] = {1: [], -1: []}
    ends: dict[int, Outcome] = {}

    def so_far() -> list[View]:
        return [*(v for v, _ in reversed(sides[-1])), start, *(v for v, _ in sides[1])]

    for sign in (1, -1):
        last, distance = start, np.inf if radius is None else radius
        while sign not in ends:
            found = _next_view(eye, last, distance, sign * step * direction, radius, threshold)
            if isinstance(found, Outcome):
                ends[sign] = found
                break
            sides[sign].append(found)
            last, distance = found
            a, b = start.line_of_sight, last.line_of_sight
            if enough is not None and enough(so_far()):
                ends[sign] = Outcome.ENOUGH
            elif np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b) >= max_angle:
                ends[sign] = Outcome.MAX_ANGLE
        if ends[sign] is Outcome.ENOUGH:
            break
        stuck = _return(eye, start, [v for v, _ in sides[sign]])
        if stuck is None and ends[sign] is Outcome.TARGET_LOST and eye.look() is None:
            stuck = Outcome.TARGET_LOST  # it is not merely out of sight
        if stuck is not None:
            ends.setdefault(-sign, stuck)
            break
    ranges = [*(r for _, r in reversed(sides[-1])), np.nan, *(r for _, r in sides[1])]
    return Arc(axis, tuple(so_far()), len(sides[-1]), (ends.get(-1, Outcome.ENOUGH), ends[1]), np.array(ranges))


def _next_view(
    eye: Eye, last: View, distance: float, shift: NDArray[np.float64], radius: float | None, threshold: float
) -> tuple[View, float] | Outcome:
    """The next view of an arc and its estimated range, or why there is none.

    ``distance`` is about the last view's range, m; ``inf`` where nobody knows.
    """
    motion = eye.arm.move_camera(RigidTransform.from_translation(shift))
    if not motion:
        return motion.reason
    looked, distance = _measured(eye, last, shift, distance)
    if looked is None:
        return Outcome.TARGET_LOST
    missing = 0.0
    if radius is not None and abs(distance - radius) < _FARTHEST * radius:
        # No more than a step at once: the next steps go on with what is left.
        missing = float(np.clip(distance - radius, -np.linalg.norm(shift), np.linalg.norm(shift)))
    centered = _recenter(eye, looked, distance, missing, threshold)
    if centered.view is None:
        return Outcome.TARGET_LOST
    return (centered.view, distance) if centered else centered.outcome


def _measured(eye: Eye, before: View, shift: NDArray[np.float64], distance: float) -> tuple[View | None, float]:
    """What the camera sees after a sidestep, and the range to it (A.1), m; ``distance`` is about the one before.

    The object is looked for where it should now show, so that a neighbor of its color is not taken for it.
    """
    lens, pixel = eye.intrinsics, before.blob.centroid
    after = eye.look(pixel - np.array([lens.fx, lens.fy]) * shift[:2] / distance)
    if after is None:
        return None, np.nan
    return after, range_to(lens, estimate_depth(lens, shift, pixel, after.blob.centroid), after.blob.centroid)


def _recenter(eye: Eye, view: View, distance: float, advance: float, threshold: float) -> Adjustment:
    """Turn toward the object of a view and move along the new line of sight, in one motion; then center."""
    eye.expect(view, growth=distance / (distance - advance) if advance else 1.0)
    turn = RigidTransform.from_rotation(toward_pixel(eye.intrinsics, view.blob.centroid))
    motion = eye.arm.move_camera(turn * RigidTransform.from_translation([0.0, 0.0, advance]))
    if not motion:
        return Adjustment(motion.reason, view, np.empty((0, 2)), motion)
    return center_on_object(eye, threshold=threshold)


def _return(eye: Eye, start: View, side: list[View]) -> Outcome | None:
    """Go back to where the traversal began; straight, or where that is barred from view to view. None: it is there."""
    motion = eye.arm.move_joints(start.joints)
    if not motion:
        for view in [*reversed(side), start]:
            motion = eye.arm.move_joints(view.joints)
    eye.expect(start)
    return None if motion else motion.reason


def _check_positive(**given: float | None) -> None:
    for name, value in given.items():
        if value is not None and not 1e-9 < value < np.inf:
            raise InvalidParameterError(f"{name} is positive and finite, in m, px or rad; got {value}")
