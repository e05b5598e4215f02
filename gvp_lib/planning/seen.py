"""Views as arrays, as the fits of solids read them: the moments of each silhouette, or the points of its outline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.sighting import View
from gvp_lib.perception.outlines import Outline
from gvp_lib.planning.room import is_foreign

__all__ = ["Observations", "Outlines", "features"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_SIDE = np.sqrt(12)  # a rectangle's side over its standard deviation
_PIXEL = 1 / 12  # px^2: a pixel's own inertia, which a blob of point masses lacks and a filled region has


def features(moments: Array) -> tuple[Array, Array]:
    """Six numbers per silhouette, in pixels and of about the same accuracy, from moments: both (..., 6). And their
    derivatives to the moments, (..., 6, 6). They are the centroid, and the roots of a twelfth of the area and of the
    second moments.
    """
    area, u, v, mu20, mu11, mu02 = np.moveaxis(moments, -1, 0)
    both = mu20 + mu02
    values = np.stack([u, v, np.sqrt(area) / _SIDE, np.sqrt(mu20), mu11 / np.sqrt(both), np.sqrt(mu02)], axis=-1)
    slopes = np.zeros((*moments.shape, 6))
    slopes[..., 0, 1] = slopes[..., 1, 2] = 1.0
    slopes[..., 2, 0] = 0.5 / (_SIDE * np.sqrt(area))
    slopes[..., 3, 3] = 0.5 / np.sqrt(mu20)
    slopes[..., 4, 4] = 1 / np.sqrt(both)
    slopes[..., 4, 3] = slopes[..., 4, 5] = -0.5 * mu11 / both**1.5
    slopes[..., 5, 5] = 0.5 / np.sqrt(mu02)
    return values, slopes


@dataclass(frozen=True, eq=False)
class Observations:
    """Views as arrays: six features of each silhouette, and where the camera stood."""

    features: Array  # (n, 6), px
    rotation: Array  # of base_from_camera, (n, 3, 3)
    position: Array  # (n, 3), m
    intrinsics: CameraIntrinsics
    feature_sd: float  # of each feature, px
    pose_sd: Array  # of a view's rotation (rad) and translation (m) in the camera's axes, (6,)

    @classmethod
    def of(cls, views: Sequence[View], intrinsics: CameraIntrinsics, feature_sd: float, pose_sd: Array) -> Observations:
        """The silhouettes of views."""
        blobs = [view.blob for view in views]
        moments = [(b.area, *b.centroid, b.mu20 + _PIXEL, b.mu11, b.mu02 + _PIXEL) for b in blobs]
        rotation = np.array([view.base_from_camera.rotation.as_matrix() for view in views])
        position = np.array([view.base_from_camera.translation for view in views])
        return cls(features(np.array(moments, float))[0], rotation, position, intrinsics, feature_sd, pose_sd)

    def some(self, count: int) -> Observations:
        """At most so many views, evenly taken."""
        chosen = _evenly(len(self.features), count)
        return replace(
            self, features=self.features[chosen], rotation=self.rotation[chosen], position=self.position[chosen]
        )

    def meeting_point(self) -> Array:
        """The point nearest to all lines of sight through the centroids, shape (3,), m; NaN where these are one."""
        rays = np.einsum("nij,nj->ni", self.rotation, self.intrinsics.rays(self.features[:, :2]))
        across = np.eye(3) - rays[:, :, None] * rays[:, None, :]  # (n, 3, 3)
        try:
            return np.linalg.solve(across.sum(0), np.einsum("nij,nj->i", across, self.position))
        except np.linalg.LinAlgError:
            return np.full(3, np.nan)


@dataclass(frozen=True, eq=False)
class Outlines:
    """Outlines of views as arrays, and where the camera stood."""

    points: Array  # (n, m, 2), px
    inside: Flags  # the object's own edge, not the picture's, (n, m)
    foreign: Flags  # outside of it is another color than the table's, (n, m)
    rotation: Array  # of base_from_camera, (n, 3, 3)
    position: Array  # (n, 3), m
    intrinsics: CameraIntrinsics
    point_sd: float  # px
    pose_sd: Array  # of a view's rotation (rad) and translation (m) in the camera's axes, (6,)
    scatter: float = 1.0  # of the poses, times what was told of them

    @classmethod
    def of(cls, views: Sequence[View], intrinsics: CameraIntrinsics, point_sd: float, pose_sd: Array) -> Outlines:
        """The outlines of views that have one."""
        outlines = [view.outline for view in views if isinstance(view.outline, Outline)]
        return cls(
            points=np.array([outline.points for outline in outlines]),
            inside=np.array([outline.inside for outline in outlines]),
            foreign=is_foreign(np.array([outline.colors for outline in outlines])),
            rotation=np.array([view.base_from_camera.rotation.as_matrix() for view in views]),
            position=np.array([view.base_from_camera.translation for view in views]),
            intrinsics=intrinsics,
            point_sd=point_sd,
            pose_sd=pose_sd,
        )

    def some(self, count: int) -> Outlines:
        """At most so many views, evenly taken."""
        chosen = _evenly(len(self.points), count)
        rows = ("points", "inside", "foreign", "rotation", "position")
        return replace(self, **{name: getattr(self, name)[chosen] for name in rows})

    def thinned(self) -> Outlines:
        """Every second point."""
        rows = ("points", "inside", "foreign")
        return replace(self, **{name: getattr(self, name)[:, ::2] for name in rows})

    def counts(self, residual: Array) -> Flags:
        """Which points say something of a solid whose outline they miss by ``residual``, (..., n, m)."""
        return self.inside & ~(self.foreign & (residual < 0))


def _evenly(n: int, count: int) -> NDArray[np.int64]:
    """Numbers of at most so many of n views, evenly taken."""
    return np.unique(np.linspace(0, n - 1, min(n, count)).round().astype(int))
