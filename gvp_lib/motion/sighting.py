"""A look through the camera: picture, mask, blob, and the pose that the arm believes it was taken from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arm import EyeInHandArm
from gvp_lib.perception.moments import Blob
from gvp_lib.perception.segmentation import Segmenter
from gvp_lib.perception.tracking import Tracker
from gvp_lib.picture import Pictured, count

__all__ = ["Eye", "View"]


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
    """

    _figure = "plot_view"

    joints: NDArray[np.float64]
    base_from_camera: RigidTransform
    blob: Blob
    clipped: bool = False
    rgb: NDArray[np.uint8] | None = field(default=None, repr=False)

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
        if not hasattr(arm, "capture"):
            raise InvalidParameterError(
                f"what moves and looks is an EyeInHandArm, such as cell.arm; got a {type(arm).__name__}"
            )
        if not callable(segmenter) or isinstance(segmenter, type):
            raise InvalidParameterError(
                "a segmenter is called with an RGB image and returns a mask, such as HsvThreshold(hue=(345, 15)); "
                f"got {segmenter!r}"
            )
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
        return View(self.arm.joints, self.arm.camera_pose(), blob, blob.touches_border(rgb.shape), kept)

    def expect(self, view: View | None, growth: float = 1.0) -> None:
        """Expect the object in the middle of the image, before a look from elsewhere.

        Parameters
        ----------
        view
            View that it should look about the same as; None: it may have any size.
        growth
            Factor by which it should look larger, where the camera came closer.
        """
        if view is None:
            self.tracker.reset()
            return
        area = max(1, round(view.blob.area * growth**2))
        self.tracker.expect(replace(view.blob, area=area, centroid=self.intrinsics.principal_point))
