"""Centering the object in the image, and turning the wrist along its major axis. Thesis 2.2, Algorithm 1, 2.3;
errata 4, 7 and 8."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arm import Motion, StopReason
from gvp_lib.motion.primitives import toward_pixel
from gvp_lib.motion.sighting import Eye, View

__all__ = ["Alignment", "Centering", "align_with_major_axis", "center_on_object", "missing_roll"]

_STILL = Motion(True, StopReason.REACHED)


@dataclass(frozen=True, eq=False)
class Centering:
    """Result of a centering.

    Attributes
    ----------
    converged
        Whether the centroid is within the threshold of the principal point.
    view
        The last view; None where the object was not in sight.
    offsets
        From the principal point to the centroid at each look, shape (n, 2), px: the convergence.
    motion
        The last motion of the arm; one that stopped early is why it did not converge.
    """

    converged: bool
    view: View | None
    offsets: NDArray[np.float64]
    motion: Motion

    def __bool__(self) -> bool:
        return self.converged

    @property
    def trouble(self) -> str:
        """What went wrong: why the arm stopped, ``"target lost"`` or ``"not centered"``; empty where it converged.

        Closed loop, environment and data sets call their failures by these words.
        """
        if self.converged:
            return ""
        if not self.motion:
            return self.motion.reason.value
        return "target lost" if self.view is None else "not centered"


def center_on_object(
    eye: Eye,
    *,
    by: Literal["turning", "shifting"] = "turning",
    depth: float | None = None,
    threshold: float = 2.0,
    max_attempts: int = 8,
    gain: float = 1.0,
) -> Centering:
    """Bring the object's centroid to the principal point (Algorithm 1; errata 8).

    Each attempt looks, and where an offset is above the threshold moves and looks again. The thesis moves by a "motion
    scalar"; a turn on the spot needs the angle of the centroid's ray at any distance, so one attempt nearly suffices.

    Parameters
    ----------
    eye
        The arm's camera, and what it looks for.
    by
        ``"turning"``: yaw and pitch, as in the thesis; the camera stays where it is. ``"shifting"``: planar steps; the
        direction of view stays what it is, which matters once it is the right one.
    depth
        Depth of the object along the optical axis, m; only shifting needs it.
    threshold
        Largest offset, px, in u and in v.
    max_attempts
        Most motions.
    gain
        Share of the offset that each motion makes good, in (0, 2): 1 goes all the way, less is the thesis's cautious
        proportional control.
    """
    if by not in ("turning", "shifting") or (by == "shifting") != (depth is not None):
        raise InvalidParameterError(
            f'center by="turning", or by="shifting" with the depth of the object in m; got by={by!r}, depth={depth}'
        )
    if not (threshold > 0 and max_attempts >= 0 and 0 < gain < 2):
        raise InvalidParameterError(
            "centering needs threshold > 0 px, max_attempts >= 0 and a gain between 0 and 2, which 1 suits; "
            f"got {threshold}, {max_attempts}, {gain}"
        )
    if depth is not None and not 0 < depth < np.inf:
        raise InvalidParameterError(f"a depth is positive and finite, in m; got {depth}")

    def correction(offset: NDArray[np.float64]) -> RigidTransform:
        if depth is None:
            return RigidTransform.from_rotation(toward_pixel(eye.intrinsics, eye.intrinsics.principal_point + offset))
        focal = (eye.intrinsics.fx, eye.intrinsics.fy)
        return RigidTransform.from_translation([*(offset * depth / focal), 0.0])

    return _center(eye, correction, threshold, max_attempts, gain)


def _center(
    eye: Eye,
    correction: Callable[[NDArray[np.float64]], RigidTransform],
    threshold: float,
    max_attempts: int,
    gain: float,
) -> Centering:
    center, motion = eye.intrinsics.principal_point, _STILL
    offsets: list[NDArray[np.float64]] = []
    view = eye.look(expected=None)
    for attempt in range(max_attempts + 1):
        if view is None:
            return Centering(False, None, np.array(offsets).reshape(-1, 2), motion)
        offset = view.blob.centroid - center
        offsets.append(offset)
        if np.abs(offset).max() < threshold:
            return Centering(True, view, np.array(offsets), motion)
        if attempt == max_attempts or not motion:
            break
        motion = eye.arm.move_camera(correction(gain * offset))
        # An arm that stopped early has moved all the same; one more look says where the object is now.
        view = eye.look(expected=center + (1 - gain) * offset if motion else None)
    return Centering(False, view, np.array(offsets), motion)


@dataclass(frozen=True, eq=False)
class Alignment:
    """Result of an alignment with the major axis.

    Attributes
    ----------
    aligned
        Whether the camera's y axis lies along the major axis, within the tolerance.
    defined
        Whether the last blob has a major axis. If not, the roll is as good as any and was kept (errata 4).
    view
        The last view; None where the object was not in sight.
    angles
        Roll missing at each look, shape (n,), rad; NaN where it is undefined.
    motion
        The last motion of the wrist.
    """

    aligned: bool
    defined: bool
    view: View | None
    angles: NDArray[np.float64]
    motion: Motion

    def __bool__(self) -> bool:
        return self.aligned


def align_with_major_axis(
    eye: Eye, *, tolerance: float = np.radians(1.0), max_attempts: int = 3, view: View | None = None
) -> Alignment:
    """Turn the wrist joint alone until the camera's y axis lies along the object's major axis (2.3, Arc Traversal).

    A major axis has no direction, so of the two rolls that align, half a turn apart, the wrist takes the smaller unless
    its limit forbids that one.

    Parameters
    ----------
    tolerance
        Largest roll that may be left, rad.
    max_attempts
        Most motions. Where the camera looks along the wrist's axis one is enough.
    view
        A view from where the arm stands, if one was just taken: it saves the first look.
    """
    motion = _STILL
    angles: list[float] = []
    view = eye.look() if view is None else view
    for attempt in range(max_attempts + 1):
        if view is None:
            return Alignment(False, False, None, np.array(angles), motion)
        missing = missing_roll(view.blob.orientation)
        angles.append(missing)
        if np.isnan(missing) or abs(missing) < tolerance:
            return Alignment(not np.isnan(missing), not np.isnan(missing), view, np.array(angles), motion)
        if attempt == max_attempts or not motion:
            break
        roll, motion = missing, eye.arm.rotate_wrist(missing)
        if motion.reason is StopReason.JOINT_LIMIT:
            roll = missing - np.copysign(np.pi, missing)
            motion = eye.arm.rotate_wrist(roll)
        view = eye.look(_rolled_pixel(eye, view, roll) if motion else None)
    return Alignment(False, True, view, np.array(angles), motion)


def _rolled_pixel(eye: Eye, view: View, roll: float) -> NDArray[np.float64]:
    """Where a view's object shows after a roll, which takes it across the image if it is not in the middle."""
    center = eye.intrinsics.principal_point
    du, dv = view.blob.centroid - center
    c, s = np.cos(roll), np.sin(roll)
    return center + (c * du + s * dv, c * dv - s * du)


def missing_roll(orientation: float) -> float:
    """The roll, rad in (-pi/2, pi/2], that brings the camera's y axis onto a major axis at ``orientation``."""
    roll = orientation - 0.5 * np.pi  # the y axis lies at pi/2; a roll by a turns the picture by -a
    return float(roll + np.pi if roll <= -0.5 * np.pi else roll)
