"""What the views of an object say, as arrays: six features of each silhouette, and where the camera stood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.sighting import View
from gvp_lib.perception.moments import Blob

__all__ = ["Observations", "features"]

Array = NDArray[np.float64]

_SIDE = np.sqrt(12)  # a rectangle's side over its standard deviation
_PIXEL = 1 / 12  # px^2: a pixel's own inertia, which a blob of point masses lacks and a filled region has


def features(area: Array, u: Array, v: Array, mu20: Array, mu11: Array, mu02: Array) -> Array:
    """Six numbers per silhouette, all in pixels and of about the same accuracy, shape (..., 6)."""
    s20, s02 = np.sqrt(mu20), np.sqrt(mu02)
    return np.stack([u, v, np.sqrt(area) / _SIDE, s20, mu11 / np.sqrt(mu20 + mu02), s02], axis=-1)


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
        return cls(features(*np.array(moments, float).T), rotation, position, intrinsics, feature_sd, pose_sd)

    def some(self, count: int) -> Observations:
        """At most so many views, evenly taken."""
        n = len(self.features)
        chosen = np.unique(np.linspace(0, n - 1, min(n, count)).round().astype(int))
        return replace(
            self, features=self.features[chosen], rotation=self.rotation[chosen], position=self.position[chosen]
        )
