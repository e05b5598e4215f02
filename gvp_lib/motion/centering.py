"""Centering the object in the image, and turning the wrist along its major axis. Thesis 2.2, Algorithm 1, 2.3;
errata 4, 7 and 8."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arm import Motion, Outcome
from gvp_lib.motion.primitives import toward_pixel
from gvp_lib.motion.sighting import Eye, View
from gvp_lib.picture import count

__all__ = ["Alignment", "Centering", "align_with_major_axis", "center_on_object", "missing_roll"]

_STILL = Motion(True, Outcome.REACHED)


@dataclass(frozen=True, eq=False)
class Centering:
    """Result of a centering, true where it converged.

    Attributes
    ----------
    converged
        Whether the centroid is within the threshold of the principal point.
    view
        Last view; None where the object was not in sight.
    offsets
        Centroid minus principal point at each look, shape (n, 2), px: the convergence.
    motion
        Last motion of the arm; one that stopped early is why the centering did not converge.
    """

    converged: bool
    view: View | None
    offsets: NDArray[np.float64]
    motion: Motion

    def __bool__(self) -> bool:
        return self.converged

    def __repr__(self) -> str:
        last = f", {np.abs(self.offsets[-1]).max():.1f} px off" if len(self.offsets) else ""
        return f"Centering({self.outcome}{last} after {count(len(self.offsets), 'look')})"

    @property
    def outcome(self) -> Outcome:
        """``REACHED``, or what went wrong: why the arm stopped, ``TARGET_LOST`` or ``NOT_CENTERED``."""
        if self.converged or not self.motion:
            return Outcome.REACHED if self.converged else self.motion.reason
        return Outcome.TARGET_LOST if self.view is None else Outcome.NOT_CENTERED


def center_on_object(
    eye: Eye,
    *,
    depth: float | None = None,
    threshold: float = 2.0,
    max_attempts: int = 8,
    gain: float = 1.0,
) -> Centering:
    """Bring the object's centroid to the principal point (Algorithm 1; errata 8).

    Each attempt looks, and where the offset is above the threshold moves and looks again. The thesis moves by a "motion
    scalar"; a turn on the spot needs only the angle of the centroid's ray, at any distance, so one attempt nearly
    suffices.

    Parameters
    ----------
    eye
        Eye on the object.
    depth
        Depth of the object along the optical axis, m. With it the camera shifts, by planar steps, and keeps its
        direction of view, which matters once that is the right one. Without it the camera turns where it stands, by
        yaw and pitch, as in the thesis.
    threshold
        Largest remaining offset, px, in u and in v.
    max_attempts
        Largest number of motions.
    gain
        Fraction of the offset that each motion corrects, in (0, 2): 1 corrects all of it, less is the thesis's cautious
        proportional control.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> cell = WorkCell(arm="floating", target="cuboid_1x2", seed=1)
    >>> bool(center_on_object(Eye(cell.arm, cell.segmenter)))
    True
    """
    if depth is not None and not 0 < depth < np.inf:
        raise InvalidParameterError(
            f"the depth of the object is positive and finite, in m, or None to center by turning; got {depth}"
        )
    if not (threshold > 0 and max_attempts >= 0 and 0 < gain < 2):
        raise InvalidParameterError(
            "centering needs threshold > 0 px, max_attempts >= 0 and a gain between 0 and 2, which 1 suits; "
            f"got {threshold}, {max_attempts}, {gain}"
        )
    lens, motion = eye.intrinsics, _STILL
    offsets: list[NDArray[np.float64]] = []
    converged, view = False, eye.look()
    for attempt in range(max_attempts + 1):
        if view is None:
            break
        offset = view.blob.centroid - lens.principal_point
        offsets.append(offset)
        converged = bool(np.abs(offset).max() < threshold)
        if converged or attempt == max_attempts or not motion:
            break
        if depth is None:
            target = RigidTransform.from_rotation(toward_pixel(lens, lens.principal_point + gain * offset))
        else:
            target = RigidTransform.from_translation([*(gain * offset * depth / (lens.fx, lens.fy)), 0.0])
        motion = eye.arm.move_camera(target)
        # An arm that stopped early has moved all the same; one more look says where the object is now.
        view = eye.look(lens.principal_point + (1 - gain) * offset if motion else None)
    return Centering(converged, view, np.array(offsets).reshape(-1, 2), motion)


@dataclass(frozen=True, eq=False)
class Alignment:
    """Result of an alignment with the major axis, true where it is aligned.

    Attributes
    ----------
    aligned
        Whether the camera's y axis lies along the major axis, within the tolerance.
    defined
        Whether the last blob has a major axis. If not, any roll is as good, and it was kept (errata 4).
    view
        Last view; None where the object was not in sight.
    angles
        Missing roll at each look, shape (n,), rad; NaN where undefined.
    motion
        Last motion of the wrist.
    """

    aligned: bool
    defined: bool
    view: View | None
    angles: NDArray[np.float64]
    motion: Motion

    def __bool__(self) -> bool:
        return self.aligned

    def __repr__(self) -> str:
        left = f", {np.degrees(self.angles[-1]):.1f} deg left" if self.defined and len(self.angles) else ""
        return f"Alignment({'aligned' if self else 'not aligned'}{left}, {self.motion.reason})"


def align_with_major_axis(
    eye: Eye, *, tolerance: float = np.radians(1.0), max_attempts: int = 3, view: View | None = None
) -> Alignment:
    """Turn the wrist joint alone until the camera's y axis lies along the object's major axis (2.3, Arc Traversal).

    Two rolls align, half a turn apart; the wrist takes the smaller unless its limit forbids it.

    Parameters
    ----------
    eye
        Eye on the object.
    tolerance
        Largest remaining roll, rad.
    max_attempts
        Largest number of motions; one is enough where the camera looks along the wrist's axis.
    view
        View just taken from where the arm stands, which saves the first look.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> cell = WorkCell(arm="floating", target="cuboid_1x4", seed=1)
    >>> bool(align_with_major_axis(Eye(cell.arm, cell.segmenter)))
    True
    """
    center, motion = eye.intrinsics.principal_point, _STILL
    angles: list[float] = []
    aligned, defined, view = False, False, eye.look() if view is None else view
    for attempt in range(max_attempts + 1):
        if view is None:
            aligned = defined = False
            break
        missing = missing_roll(view.blob.orientation)
        angles.append(missing)
        aligned, defined = bool(abs(missing) < tolerance), not np.isnan(missing)
        if aligned or not defined or attempt == max_attempts or not motion:
            break
        roll, motion = missing, eye.arm.rotate_wrist(missing)
        if motion.reason is Outcome.JOINT_LIMIT:
            roll = missing - np.copysign(np.pi, missing)
            motion = eye.arm.rotate_wrist(roll)
        # A roll takes the object across the image if it is not in the middle.
        (du, dv), c, s = view.blob.centroid - center, np.cos(roll), np.sin(roll)
        view = eye.look(center + (c * du + s * dv, c * dv - s * du) if motion else None)
    return Alignment(aligned, defined, view, np.array(angles), motion)


def missing_roll(orientation: float) -> float:
    """The roll, rad in (-pi/2, pi/2], that brings the camera's y axis onto a major axis at ``orientation``."""
    roll = orientation - 0.5 * np.pi  # the y axis lies at pi/2; a roll by a turns the picture by -a
    return float(roll + np.pi if roll <= -0.5 * np.pi else roll)
