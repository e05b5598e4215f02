"""Calibrating a lens from pictures of a chessboard: the one thing about the robot that the thesis calibrates."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from gvp_lib.errors import CalibrationError, InvalidImageError, InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics

__all__ = ["Calibration", "calibrate"]

_LEAST_PICTURES = 3
# Pictures of parallel boards fit any focal length, and the fit's own standard deviation does not betray it.
_LEAST_TILT = np.radians(10)  # the most that two pictures' boards must differ by


@dataclass(frozen=True, eq=False)
class Calibration:
    """A lens: pinhole and distortion.

    Attributes
    ----------
    intrinsics
        The pinhole, which also holds for pictures that :meth:`undistort` gives.
    distortion
        Shape (5,), OpenCV's k1, k2, p1, p2, k3; read-only.
    rms_px
        Root mean square distance, px, of the corners found from where the calibrated lens puts them. That it is
        small (below 0.5) does not say that the lens is right where no picture showed the board.
    focal_deviation
        Standard deviation of (fx, fy), px, from that distance; shape (2,).
    used
        Which of the pictures showed the board, as indices from 0.
    """

    intrinsics: CameraIntrinsics
    distortion: NDArray[np.float64]
    rms_px: float
    focal_deviation: NDArray[np.float64]
    used: tuple[int, ...]

    def __post_init__(self) -> None:
        for name in ("distortion", "focal_deviation"):
            array = np.array(getattr(self, name), float).ravel()
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    def undistort(self, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The picture as a pinhole with ``intrinsics`` would have taken it, uint8 (H, W, 3); black where unseen."""
        expected = (self.intrinsics.height, self.intrinsics.width, 3)
        if np.shape(rgb) != expected:
            raise InvalidImageError(f"the calibrated camera takes pictures of shape {expected}; got {np.shape(rgb)}")
        return np.asarray(cv2.remap(rgb, *self._maps, cv2.INTER_LINEAR), np.uint8)

    def undistort_pixels(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Where the pinhole would have seen what the lens saw at ``pixels``, ``(u, v)``, shape (..., 2)."""
        pixels = np.asarray(pixels, float)
        k = self.intrinsics.matrix
        flat = cv2.undistortPoints(pixels.reshape(-1, 1, 2), k, self.distortion, P=k)
        return np.asarray(flat, float).reshape(pixels.shape)

    @cached_property
    def _maps(self) -> tuple[Any, Any]:
        k, size = self.intrinsics.matrix, (self.intrinsics.width, self.intrinsics.height)
        return cv2.initUndistortRectifyMap(k, self.distortion, np.eye(3), k, size, cv2.CV_16SC2)


def calibrate(pictures: Iterable[NDArray[np.uint8]], corners: tuple[int, int], square: float = 1.0) -> Calibration:
    """Calibrate a camera from pictures of one flat chessboard (Zhang's method, in OpenCV).

    Parameters
    ----------
    pictures
        RGB uint8 (H, W, 3), all of one size, of the board from different sides, tilted by 20 degrees and more, and
        together filling the image. Ten to twenty do; pictures that do not show the whole board are passed over.
    corners
        Number of inner corners in a row and in a column of the board: (9, 6) for 10 x 7 squares.
    square
        Side of a square, m. The intrinsics do not depend on it.
    """
    if len(corners) != 2 or min(corners) < 3 or not square > 0:
        raise InvalidParameterError(
            "corners are the inner corners of the board, at least (3, 3), one fewer than its squares either way, and "
            f"a square's side is positive, in meters; got corners={corners}, square={square}"
        )
    board = np.zeros((corners[0] * corners[1], 3), np.float32)
    board[:, :2] = np.mgrid[: corners[0], : corners[1]].T.reshape(-1, 2) * square
    found: list[NDArray[np.float32]] = []
    used: list[int] = []
    shape: tuple[int, ...] | None = None
    n = 0
    for n, picture in enumerate(pictures, start=1):
        shape = _checked_shape(picture, n, shape)
        seen, at = cv2.findChessboardCornersSB(
            cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), corners, flags=cv2.CALIB_CB_ACCURACY
        )
        if seen:
            found.append(np.asarray(at, np.float32).reshape(-1, 2))
            used.append(n - 1)
    if len(found) < _LEAST_PICTURES or shape is None:
        raise CalibrationError(
            f"{len(found)} of {n} pictures showed a board of {corners[0]} x {corners[1]} inner corners; at least "
            f"{_LEAST_PICTURES} must. Count inner corners, not squares; show the whole board with a white margin"
        )
    return _fitted(board, found, (shape[1], shape[0]), tuple(used))


def _fitted(
    board: NDArray[np.float32], found: list[NDArray[np.float32]], size: tuple[int, int], used: tuple[int, ...]
) -> Calibration:
    """The lens that fits the corners found best; ``size`` is (width, height)."""
    rms, k, distortion, rotations, _, deviation, *_ = cv2.calibrateCameraExtended(
        [board] * len(found), found, size, np.zeros((3, 3)), np.zeros(5)
    )
    normals = Rotation.from_rotvec(np.array(rotations, float).reshape(-1, 3)).apply((0, 0, 1))  # (n, 3)
    tilt = np.arccos(np.clip((normals @ normals.T).min(), -1, 1))
    if not np.isfinite(k).all() or tilt < _LEAST_TILT:
        raise CalibrationError(
            f"{len(found)} pictures showed the board, but within {np.degrees(tilt):.1f} degrees of parallel, which "
            "any focal length explains. Take some with the board tilted by 30 degrees, about either axis"
        )
    intrinsics = CameraIntrinsics(*size, *(float(x) for x in (k[0, 0], k[1, 1], k[0, 2], k[1, 2])))
    return Calibration(
        intrinsics, np.array(distortion, float).ravel()[:5], float(rms), np.array(deviation, float).ravel()[:2], used
    )


def _checked_shape(picture: object, number: int, shape: tuple[int, ...] | None) -> tuple[int, ...]:
    """The picture's shape, if it is an RGB image of the same shape as those before."""
    if not (isinstance(picture, np.ndarray) and picture.dtype == np.uint8 and picture.ndim == 3):
        got = f"{picture.dtype} {picture.shape}" if isinstance(picture, np.ndarray) else type(picture).__name__
        raise InvalidImageError(f"pictures are RGB images, uint8 (H, W, 3); number {number} is {got}")
    if picture.shape[2] != 3 or (shape is not None and picture.shape != shape):
        raise InvalidImageError(
            f"pictures are RGB images of one camera, all of one size; number {number} has shape {picture.shape}"
            + (f", those before {shape}" if shape else "")
        )
    return picture.shape
