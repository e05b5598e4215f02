"""Traversal of an arc of the virtual sphere, centered on the object. Thesis 2.2, 2.3, Algorithm 2; errata 10 to 12."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arm import Motion, StopReason
from gvp_lib.motion.centering import Centering, center_on_object
from gvp_lib.motion.primitives import estimate_depth, range_to, toward_pixel
from gvp_lib.motion.sighting import Eye, View
from gvp_lib.picture import Pictured

__all__ = ["Arc", "ArcEnd", "Approach", "approach", "traverse_arc"]

Axis = Literal["x", "y"]
_FARTHEST = 0.5  # of the radius: a range that differs by more is a wrong measurement, or the sphere is not ours yet
_SIDEWAYS = (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)


class ArcEnd(Enum):
    """Why a traversal stopped on one side."""

    JOINT_LIMIT = "joint limit"
    COLLISION = "collision"
    UNREACHABLE = "unreachable"
    CONTACT = "contact"
    STALLED = "stalled"
    TARGET_LOST = "target lost"
    NOT_CENTERED = "not centered"  # the arm moved, and the object did not come to the middle of the image
    ANGLE = "angle"  # as far as was asked for
    ENOUGH = "enough"  # the caller had seen enough


@dataclass(frozen=True, eq=False)
class Arc(Pictured):
    """Views along an arc of the virtual sphere.

    Attributes
    ----------
    axis
        The camera's axis along which it moved.
    views
        Views from the far end on the negative side of that axis to the far end on the positive side.
    center
        Index of the view from which the traversal began; -1 where there is no view at all.
    ends
        Reasons why it stopped on the negative side, and on the positive.
    ranges
        Estimated distance to the object at each step (A.1), shape (n,), m; NaN at the center.
    """

    _figure = "plot_arc"

    axis: Axis
    views: tuple[View, ...]
    center: int
    ends: tuple[ArcEnd, ArcEnd]
    ranges: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.views)

    @cached_property
    def angles(self) -> NDArray[np.float64]:
        """Believed angle from the center to each view about the camera's other axis, shape (n,), rad, rising."""
        if not self.views:
            return np.empty(0)
        center_from_base = self.views[self.center].base_from_camera.rotation.inv()
        x, y, z = np.transpose([(center_from_base * v.base_from_camera.rotation).as_matrix()[:, 2] for v in self.views])
        # Moving along +y, the camera turns so as to look back along -y.
        return -np.arctan2(y if self.axis == "y" else x, z)

    @cached_property
    def ratios(self) -> NDArray[np.float64]:
        """Minor over major axis in each view, shape (n,): R of 2.3."""
        return np.array([view.blob.ratio for view in self.views])


@dataclass(frozen=True, eq=False)
class Approach:
    """Result of an approach to the radius.

    Attributes
    ----------
    view, motion
        The last view, None where the object was lost; and the last motion, one that reached its goal where the
        attempts ran out with the object in the middle.
    distance
        Estimated distance from the camera to the object, m; NaN where none could be estimated.
    """

    view: View | None
    distance: float
    motion: Motion


def approach(eye: Eye, radius: float, *, step: float = 0.02, tolerance: float = 0.05, attempts: int = 4) -> Approach:
    """Come to ``radius`` m from the object, centered on it, by depth from motion alone (2.2, Distance Adjustment).

    Each attempt steps sideways, to and fro in turn, estimates the range, and moves along the line of sight by what is
    missing, until that is within ``tolerance`` of the radius. Where the arm cannot step one way it steps another.
    """
    _check_positive(radius=radius, step=step, tolerance=tolerance)
    centered, distance = center_on_object(eye), np.nan
    for attempt in range(attempts):
        view = centered.view
        if view is None or not centered:
            break
        shift, motion = _sidestep(eye, view, step, attempt)
        looked, measured = _measured(eye, view, shift, radius) if motion else (view, np.nan)
        if looked is None or not motion:
            return Approach(looked, np.nan, motion)
        known = np.isfinite(measured)
        missing = measured - radius if known else 0.0
        centered, distance = _recenter(eye, looked, measured, missing, 2.0), measured - missing if known else np.nan
        if centered and known and abs(missing) < tolerance * radius:
            break
    else:
        if centered:  # out of attempts, but near enough to go on from
            return Approach(centered.view, distance, Motion(True, StopReason.REACHED))
    return Approach(centered.view, distance if centered else np.nan, centered.motion)


def _sidestep(eye: Eye, view: View, step: float, first: int) -> tuple[NDArray[np.float64], Motion]:
    """A step in the first direction of four that the arm can make, from where ``view`` was taken; how it went."""
    for turn in range(4):
        shift = step * np.array(_SIDEWAYS[(first + turn) % 4])
        motion = eye.arm.move_camera(RigidTransform.from_translation(shift))
        if motion or not eye.arm.move_joints(view.joints):
            break
    return shift, motion


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
    3. recenter, and along the new line of sight make good what the range lacks to the radius,
    4. keep joints, blob and pose.

    Between the sides and at the end the arm returns to where it began.

    Parameters
    ----------
    axis
        ``"y"`` or ``"x"``: the camera's axis to move along. With y on the object's major axis, ``"y"`` turns about
        the minor axis and ``"x"`` about the major one (errata 12).
    radius
        Radius of the sphere, m; None leaves the range alone, so that it grows with every tangential step.
    step
        Length of a step, m. Smaller is better and slower (3.1.6).
    max_angle
        Largest angle on each side, rad.
    threshold
        Largest offset after a centering, px.
    enough
        Called after each view with all views so far, in the order of the arc; true ends the traversal where the arm
        stands.
    """
    if axis not in ("x", "y"):
        raise InvalidParameterError(f'an arc goes along the camera\'s axis "x" or "y"; got {axis!r}')
    _check_positive(radius=radius, step=step, max_angle=max_angle, threshold=threshold)
    if max_angle > np.pi:
        raise InvalidParameterError(f"max_angle is in radians, at most pi; got {max_angle}. For degrees: np.radians(…)")
    start = eye.look()
    if start is None:
        return Arc(axis, (), -1, (ArcEnd.TARGET_LOST, ArcEnd.TARGET_LOST), np.empty(0))
    direction = np.array([0.0, 1.0, 0.0] if axis == "y" else [1.0, 0.0, 0.0])
    sides: dict[int, list[tuple[View, float]]] = {1: [], -1: []}
    ends: dict[int, ArcEnd] = {}

    def so_far() -> list[View]:
        return [*(v for v, _ in reversed(sides[-1])), start, *(v for v, _ in sides[1])]

    for sign in (1, -1):
        last, distance = start, np.inf if radius is None else radius
        while sign not in ends:
            found = _next_view(eye, last, distance, sign * step * direction, radius, threshold)
            if isinstance(found, ArcEnd):
                ends[sign] = found
                break
            sides[sign].append(found)
            last, distance = found
            a, b = start.line_of_sight, last.line_of_sight
            if enough is not None and enough(so_far()):
                ends[sign] = ArcEnd.ENOUGH
            elif np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b) >= max_angle:
                ends[sign] = ArcEnd.ANGLE
        if ends[sign] is ArcEnd.ENOUGH:
            break
        stuck = _return(eye, start, [v for v, _ in sides[sign]])
        if stuck is None and ends[sign] is ArcEnd.TARGET_LOST and eye.look() is None:
            stuck = ArcEnd.TARGET_LOST  # it is not merely out of sight
        if stuck is not None:
            ends.setdefault(-sign, stuck)
            break
    ranges = [*(r for _, r in reversed(sides[-1])), np.nan, *(r for _, r in sides[1])]
    return Arc(axis, tuple(so_far()), len(sides[-1]), (ends.get(-1, ArcEnd.ENOUGH), ends[1]), np.array(ranges))


def _next_view(
    eye: Eye, last: View, distance: float, shift: NDArray[np.float64], radius: float | None, threshold: float
) -> tuple[View, float] | ArcEnd:
    """The next view of an arc and its estimated range, or why there is none.

    ``distance`` is about the last view's range, m; ``inf`` where nobody knows.
    """
    motion = eye.arm.move_camera(RigidTransform.from_translation(shift))
    if not motion:
        return ArcEnd(motion.reason.value)
    looked, distance = _measured(eye, last, shift, distance)
    if looked is None:
        return ArcEnd.TARGET_LOST
    missing = 0.0
    if radius is not None and abs(distance - radius) < _FARTHEST * radius:
        # No more than a step at once: the next steps go on with what is left.
        missing = float(np.clip(distance - radius, -np.linalg.norm(shift), np.linalg.norm(shift)))
    centered = _recenter(eye, looked, distance, missing, threshold)
    if centered.view is None:
        return ArcEnd.TARGET_LOST
    return (centered.view, distance) if centered else ArcEnd(centered.trouble)


def _measured(eye: Eye, before: View, shift: NDArray[np.float64], distance: float) -> tuple[View | None, float]:
    """What the camera sees after a sidestep, and the range to it (A.1), m; ``distance`` is about the one before.

    The object is looked for where it should now show, so that a neighbor of its color is not taken for it.
    """
    lens, pixel = eye.intrinsics, before.blob.centroid
    after = eye.look(pixel - np.array([lens.fx, lens.fy]) * shift[:2] / distance)
    if after is None:
        return None, np.nan
    return after, range_to(lens, estimate_depth(lens, shift, pixel, after.blob.centroid), after.blob.centroid)


def _recenter(eye: Eye, view: View, distance: float, advance: float, threshold: float) -> Centering:
    """Turn toward the object of a view and move along the new line of sight, in one motion; then center."""
    eye.expect(view, growth=distance / (distance - advance) if advance else 1.0)
    turn = RigidTransform.from_rotation(toward_pixel(eye.intrinsics, view.blob.centroid))
    motion = eye.arm.move_camera(turn * RigidTransform.from_translation([0.0, 0.0, advance]))
    if not motion:
        return Centering(False, view, np.empty((0, 2)), motion)
    return center_on_object(eye, threshold=threshold)


def _return(eye: Eye, start: View, side: list[View]) -> ArcEnd | None:
    """Go back to where the traversal began; straight, or where that is barred from view to view. None: it is there."""
    motion = eye.arm.move_joints(start.joints)
    if not motion:
        for view in [*reversed(side), start]:
            motion = eye.arm.move_joints(view.joints)
    eye.expect(start)
    return None if motion else ArcEnd(motion.reason.value)


def _check_positive(**given: float | None) -> None:
    for name, value in given.items():
        if value is not None and not 0 < value < np.inf:
            raise InvalidParameterError(f"{name} is positive and finite, in m, px or rad; got {value}")
