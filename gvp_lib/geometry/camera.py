"""Intrinsics of a pinhole camera, the only thing that the thesis calibrates.

The camera frame is the optical frame: x right, y down, z forward. A pixel is ``(u, v)``, u right and v down,
with its origin at the center of the top-left pixel, so that the image spans -0.5 … width - 0.5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError

__all__ = ["CameraIntrinsics"]


@checked
@dataclass(frozen=True, slots=True)
class CameraIntrinsics:
    """Focal lengths and principal point of a pinhole camera, in pixels.

    Parameters
    ----------
    width, height
        Image size, px.
    fx, fy
        Focal length in units of a pixel's width and of its height (thesis A.1: f / rho_u, f / rho_v).
    cx, cy
        Principal point, px.

    Examples
    --------
    >>> camera = CameraIntrinsics(640, 480, 530, 530, 319.5, 239.5)
    >>> camera.project((0.1, 0, 1)).tolist()
    [372.5, 239.5]
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        numbers = self.width, self.height, self.fx, self.fy, self.cx, self.cy
        if not (np.isfinite(numbers).all() and min(numbers[:4]) > 0):
            raise InvalidParameterError(
                "an image's size and its focal lengths are positive, in pixels, and all finite; "
                f"got {self.width} x {self.height} pixels, fx={self.fx}, fy={self.fy}, cx={self.cx}, cy={self.cy}"
            )

    @classmethod
    def from_fov(cls, fovy: float, width: int, height: int) -> CameraIntrinsics:
        """Camera of square pixels and a centered principal point, from its vertical field of view.

        Parameters
        ----------
        fovy
            Vertical field of view, rad, in (0, pi).
        width, height
            Image size, px.

        Examples
        --------
        >>> CameraIntrinsics.from_fov(np.radians(48.8), 640, 480)
        CameraIntrinsics(width=640, height=480, fx=529.077, fy=529.077, cx=319.5, cy=239.5)
        """
        if not 0 < fovy < np.pi:
            raise InvalidParameterError(
                f"a vertical field of view is in radians, between 0 and pi; got {fovy} "
                f"(if those are degrees, {np.radians(fovy):.4f} rad)"
            )
        f = 0.5 * height / np.tan(0.5 * fovy)
        return cls(width, height, float(f), float(f), 0.5 * (width - 1), 0.5 * (height - 1))

    def __repr__(self) -> str:
        numbers = ", ".join(f"{name}={getattr(self, name):.6g}" for name in ("fx", "fy", "cx", "cy"))
        return f"CameraIntrinsics(width={self.width}, height={self.height}, {numbers})"

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Calibration matrix K, shape (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def fovy(self) -> float:
        """Vertical field of view, rad."""
        return float(2 * np.arctan(0.5 * self.height / self.fy))

    @property
    def principal_point(self) -> NDArray[np.float64]:
        """``(cx, cy)``, px, shape (2,)."""
        return np.array([self.cx, self.cy])

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Project points to pixels ``(u, v)``, shape (..., 2).

        Parameters
        ----------
        points
            Points in the camera frame, m, shape (..., 3).

        Notes
        -----
        A point that is not in front of the camera projects to NaN. Nothing is clipped to the image.
        """
        points = np.asarray(points, float)
        if points.ndim == 0 or points.shape[-1] != 3:
            raise InvalidParameterError(f"points in the camera frame have shape (..., 3); got {points.shape}")
        z = points[..., 2:]
        with np.errstate(divide="ignore", invalid="ignore"):
            normalized = np.where(z > 0, points[..., :2] / z, np.nan)
        return normalized * (self.fx, self.fy) + (self.cx, self.cy)

    def rays(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Rays through pixels: unit vectors in the camera frame, shape (..., 3).

        The inverse of :meth:`project` up to depth.

        Parameters
        ----------
        pixels
            Pixels ``(u, v)``, shape (..., 2).
        """
        pixels = np.asarray(pixels, float)
        if pixels.ndim == 0 or pixels.shape[-1] != 2:
            raise InvalidParameterError(f"pixels (u, v) have shape (..., 2); got {pixels.shape}")
        rays = np.ones((*pixels.shape[:-1], 3))
        rays[..., :2] = (pixels - (self.cx, self.cy)) / (self.fx, self.fy)
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)
