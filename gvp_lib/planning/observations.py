"""What the views of an object say, as arrays: six features of each silhouette, and where the camera stood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.sighting import View
from gvp_lib.perception.moments import Blob

__all__ = ["Observations", "feature_derivatives", "features"]

Array = NDArray[np.float64]

_SIDE = np.sqrt(12)  # a rectangle's side over its standard deviation
_PIXEL = 1 / 12  # px^2: a pixel's own inertia, which a blob of point masses lacks and a filled region has


def features(moments: Array) -> Array:
    """Six numbers per silhouette, all in pixels and of about the same accuracy, from moments: both (..., 6).

    They are the centroid, the side of a square as large as a twelfth of the area, and the roots of the second moments.
    """
    area, u, v, mu20, mu11, mu02 = np.moveaxis(moments, -1, 0)
    return np.stack([u, v, np.sqrt(area) / _SIDE, np.sqrt(mu20), mu11 / np.sqrt(mu20 + mu02), np.sqrt(mu02)], axis=-1)


def feature_derivatives(moments: Array) -> Array:
    """Derivatives of the features to the moments, shape (..., 6, 6)."""
    area, _, _, mu20, mu11, mu02 = np.moveaxis(moments, -1, 0)
    both = mu20 + mu02
    found = np.zeros((*moments.shape, 6))
    found[..., 0, 1] = found[..., 1, 2] = 1.0
    found[..., 2, 0] = 0.5 / (_SIDE * np.sqrt(area))
    found[..., 3, 3] = 0.5 / np.sqrt(mu20)
    found[..., 4, 4] = 1 / np.sqrt(both)
    found[..., 4, 3] = found[..., 4, 5] = -0.5 * mu11 / both**1.5
    found[..., 5, 5] = 0.5 / np.sqrt(mu02)
    return found


@dataclass(frozen=True, eq=False)
class Observations:
    """What the views say, as arrays.

    Attributes
    ----------
    features
        Shape (n, 6), px; see :func:`features`.
    rotation, position
        ``base_from_camera``, shapes (n, 3, 3) and (n, 3), m.
    intrinsics
        Of the lens.
    feature_sd
        Of each feature, px.
    pose_sd
        Of a view's pose, shape (6,): rotation (rad) and translation (m) in the camera's axes.
    """

    features: Array
    rotation: Array
    position: Array
    intrinsics: CameraIntrinsics
    feature_sd: float
    pose_sd: Array

    @classmethod
    def of(cls, views: Sequence[View], intrinsics: CameraIntrinsics, feature_sd: float, pose_sd: Array) -> Observations:
        """Those of views."""
        blobs: list[Blob] = [view.blob for view in views]
        moments = [(b.area, *b.centroid, b.mu20 + _PIXEL, b.mu11, b.mu02 + _PIXEL) for b in blobs]
        rotation = np.array([view.base_from_camera.rotation.as_matrix() for view in views])
        position = np.array([view.base_from_camera.translation for view in views])
        return cls(features(np.array(moments, float)), rotation, position, intrinsics, feature_sd, pose_sd)

    def some(self, count: int) -> Observations:
        """At most so many views, evenly taken."""
        n = len(self.features)
        chosen = np.unique(np.linspace(0, n - 1, min(n, count)).round().astype(int))
        return replace(
            self, features=self.features[chosen], rotation=self.rotation[chosen], position=self.position[chosen]
        )
