"""A look through the camera, and the two corrections of the pose that one look asks for: the object into the middle of
the image, the wrist along its major axis. Thesis 2.2, Algorithm 1, 2.3; errata 4, 7 and 8."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arm import EyeInHandArm, Motion, Outcome
from gvp_lib.motion.primitives import toward_pixel
from gvp_lib.perception.blobs import Blob, Tracker
from gvp_lib.perception.outlines import Outline
from gvp_lib.perception.segmentation import Segmenter
from gvp_lib.picture import Pictured, count

__all__ = ["Adjustment", "Eye", "View", "align_with_major_axis", "center_on_object", "missing_roll"]

_STILL = Motion(True, Outcome.REACHED)


THUMBNAIL = 8  # px of a picture to one of its thumbnail


@dataclass(frozen=True, eq=False)
class View(Pictured):
    """View of the object: its blob, and where the camera stood.

    Attributes
    ----------
    joints
        Joint angles as the encoders read them, shape (n,), rad, read-only.
    base_from_camera
        Pose of the camera as the arm believes it.
    blob
        Moments of the object's silhouette.
    clipped
        Whether the blob touches the border of the image, so that part of the object may be out of sight.
    rgb
        Picture, uint8 (H, W, 3), where it was asked to be kept.
    outline
        The blob's outline, with the colors about it; None in a view that was not taken by :class:`Eye`.
    thumbnail
        Every eighth pixel of the picture, uint8 (H / 8, W / 8, 3), 14 kB; None as for the outline.
    """

    _figure = "plot_view"

    joints: NDArray[np.float64]
    base_from_camera: RigidTransform
    blob: Blob
    clipped: bool = False
    rgb: NDArray[np.uint8] | None = field(default=None, repr=False)
    outline: Outline | None = field(default=None, repr=False)
    thumbnail: NDArray[np.uint8] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        joints = np.array(self.joints, float)
        joints.flags.writeable = False
        object.__setattr__(self, "joints", joints)

    def __repr__(self) -> str:
        clipped = ", clipped" if self.clipped else ""
        return f"View({self.blob}{clipped}{', with its picture' if self.rgb is not None else ''})"

    @cached_property
    def line_of_sight(self) -> NDArray[np.float64]:
        """The optical axis, away from the camera, as a unit vector of shape (3,) in the base frame."""
        return np.asarray(self.base_from_camera.rotation.as_matrix()[:, 2])


@checked
class Eye:
    """Camera in a hand that keeps its eye on one object: a segmenter, and a memory of where the object was.

    Where the segmenter finds several objects, the target is the one nearest the middle of the first picture; from then
    on a :class:`gvp_lib.perception.Tracker` follows it. A segmenter that is a tracker already is used as it is.

    Parameters
    ----------
    arm
        Arm that moves the camera and takes the pictures.
    segmenter
        RGB uint8 (H, W, 3) to mask bool (H, W).
    keep_images
        Whether each view keeps its picture (0.9 MB).
    on_look
        Function called at every look with the picture and the blob, or None.

    Attributes
    ----------
    looks
        Number of pictures taken so far.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> cell = WorkCell(arm="floating", target="cuboid_1x2", seed=1)
    >>> eye = Eye(cell.arm, cell.segmenter)
    >>> eye.look().clipped, eye.looks
    (False, 1)
    """

    def __init__(
        self,
        arm: EyeInHandArm,
        segmenter: Segmenter,
        *,
        keep_images: bool = False,
        on_look: Callable[[NDArray[np.uint8], Blob | None], None] | None = None,
    ) -> None:
        self.arm = arm
        self.intrinsics = arm.intrinsics
        # When a second object slides in front of ours, or into one region with it, the blob leaps: then ours counts as
        # lost rather than as larger.
        followed = Tracker(segmenter, "center", max_growth=1.5)
        self.tracker = segmenter if isinstance(segmenter, Tracker) else followed
        self.keep_images, self.on_look, self.looks = keep_images, on_look, 0

    def __repr__(self) -> str:
        return f"Eye({type(self.arm).__name__}, {type(self.tracker.segmenter).__name__}, {count(self.looks, 'look')})"

    def look(self, expected: ArrayLike | None = None) -> View | None:
        """Take a picture and find the object in it; None where it is lost or not in view.

        Parameters
        ----------
        expected
            Pixel (u, v) near which the object should be, for a caller who knows how the camera moved.
        """
        rgb = self.arm.capture()
        self.looks += 1
        blob = self.tracker.observe(rgb, expected)
        if self.on_look is not None:
            self.on_look(rgb, blob)
        if blob is None:
            return None
        kept = rgb if self.keep_images else None
        outline = Outline.of(blob, rgb)
        small = rgb[THUMBNAIL // 2 :: THUMBNAIL, THUMBNAIL // 2 :: THUMBNAIL].copy()
        return View(self.arm.joints, self.arm.camera_pose(), blob, blob.touches_border(rgb.shape), kept, outline, small)

    def expect(self, view: View | None, growth: float = 1.0) -> None:
        """Expect the object in the middle of the image, before a look from elsewhere.

        Parameters
        ----------
        view
            View that it should look about the same as; None: it may have any size.
        growth
            Factor by which it should look larger, where the camera came closer.
        """
        if not 0 < growth < np.inf:
            raise InvalidParameterError(f"growth is a factor, positive and finite; got {growth}")
        if view is None:
            self.tracker.reset()
            return
        area = max(1, round(view.blob.area * growth**2))
        self.tracker.expect(replace(view.blob, area=area, centroid=self.intrinsics.principal_point))


@dataclass(frozen=True, eq=False)
class Adjustment:
    """Result of a centering, an alignment or an approach, true where what was to vanish is within its tolerance.

    Attributes
    ----------
    outcome
        ``REACHED``, or what went wrong: why the arm stopped, ``TARGET_LOST``, ``NOT_CENTERED``, ``OUT_OF_STEPS`` where
        the attempts ran out, or ``ANY_ANGLE`` where the blob has no major axis, so that any roll is as good and it was
        kept (errata 4).
    view
        Last view; None where the object was not in sight.
    errors
        What was to vanish, as each look measured it. Of a centering: centroid minus principal point, shape (n, 2), px.
        Of an alignment: the missing roll, shape (n,), rad. Of an approach: the distance beyond the radius, shape (n,),
        m. NaN where a look did not tell.
    motion
        Last motion of the arm.
    """

    outcome: Outcome
    view: View | None
    errors: NDArray[np.float64]
    motion: Motion

    def __bool__(self) -> bool:
        return self.outcome is Outcome.REACHED

    def __repr__(self) -> str:
        return f"Adjustment({self.outcome}, {count(len(self.errors), 'look')})"


def ended(done: bool, view: View | None, motion: Motion, otherwise: Outcome) -> Outcome:
    """Outcome of an adjustment; ``otherwise`` where it is not done though the arm moves and the object is in sight."""
    if done:
        return Outcome.REACHED
    if not motion:
        return motion.reason
    return Outcome.TARGET_LOST if view is None else otherwise


@checked
def center_on_object(
    eye: Eye,
    *,
    depth: float | None = None,
    threshold: float = 2.0,
    max_attempts: int = 8,
    gain: float = 1.0,
) -> Adjustment:
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
    outcome = ended(converged, view, motion, Outcome.NOT_CENTERED)
    return Adjustment(outcome, view, np.array(offsets).reshape(-1, 2), motion)


@checked
def align_with_major_axis(
    eye: Eye, *, tolerance: float = np.radians(1.0), max_attempts: int = 3, view: View | None = None
) -> Adjustment:
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
    aligned, defined, view = False, True, eye.look() if view is None else view
    for attempt in range(max_attempts + 1):
        if view is None:
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
    outcome = ended(aligned, view, motion, Outcome.OUT_OF_STEPS if defined else Outcome.ANY_ANGLE)
    return Adjustment(outcome, view, np.array(angles), motion)


def meeting_point(views: Sequence[View], intrinsics: CameraIntrinsics) -> NDArray[np.float64]:
    """The point nearest to the lines of sight through the blobs' centroids, base frame, shape (3,), m; NaN where these
    are one."""
    rays = [intrinsics.rays(view.blob.centroid) for view in views]
    rays = [v.base_from_camera.rotation.apply(ray / np.linalg.norm(ray)) for v, ray in zip(views, rays, strict=True)]
    across = [np.eye(3) - np.outer(ray, ray) for ray in rays]
    places = [part @ view.base_from_camera.translation for part, view in zip(across, views, strict=True)]
    try:
        return np.asarray(np.linalg.solve(np.sum(across, axis=0), np.sum(places, axis=0)))
    except np.linalg.LinAlgError:
        return np.full(3, np.nan)


def missing_roll(orientation: float) -> float:
    """The roll, rad in (-pi/2, pi/2], that brings the camera's y axis onto a major axis at ``orientation``."""
    roll = orientation - 0.5 * np.pi  # the y axis lies at pi/2; a roll by a turns the picture by -a
    return float(roll + np.pi if roll <= -0.5 * np.pi else roll)
