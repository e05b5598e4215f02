"""Calibration from images of a chessboard: of the lens, and of the camera's pose in the hand.

The thesis calibrates the lens alone, because its planner rotates the wrist about the lens by what it sees. An adapter
for a real arm also needs the camera's pose in the hand: :meth:`gvp_lib.EyeInHandArm.camera_pose` is the pose of the
lens, and a robot's controller reports that of its flange.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import checked
from gvp_lib.errors import CalibrationError, InvalidImageError, InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.picture import Pictured

__all__ = ["Calibration", "HandEye", "calibrate", "calibrate_hand_eye"]

_MIN_SAMPLES = 3  # pictures of the board, and pairs of poses
# Pictures of parallel boards fit any focal length, and the fit's own standard deviation does not show it.
_MIN_TILT = np.radians(10)  # between the two boards that differ most
_MIN_ROTATION = np.radians(10)  # of the hand, about each of two axes
_ROTATION_SCALE = 0.3  # m/rad: weighs the board's rotation against its translation


@checked
@dataclass(frozen=True, eq=False)
class Calibration(Pictured):
    """Calibrated lens: pinhole camera and distortion.

    Attributes
    ----------
    intrinsics
        Pinhole camera; it also holds for images from :meth:`undistort`.
    distortion
        OpenCV's coefficients k1, k2, p1, p2, k3, shape (5,), read-only.
    rms_px
        Root-mean-square reprojection error of the corners, px. A small one (below 0.5) says nothing about parts of the
        image where no picture showed the board.
    focal_deviation
        Standard deviation of (fx, fy) that follows from this error, px, shape (2,), read-only.
    used
        Indices of the pictures that showed the board, from 0.
    """

    _figure = "plot_calibration"

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

    def __repr__(self) -> str:
        lens, (sx, sy) = self.intrinsics, self.focal_deviation
        return (
            f"Calibration({lens.width} x {lens.height} px, fx {lens.fx:.1f} (sd {sx:.2g}) px, "
            f"fy {lens.fy:.1f} (sd {sy:.2g}) px, rms {self.rms_px:.2g} px, {len(self.used)} pictures)"
        )

    def undistort(self, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Image as the pinhole camera ``intrinsics`` would take it, uint8 (H, W, 3); black where the lens saw nothing.

        Parameters
        ----------
        rgb
            Image from the calibrated camera, uint8 (H, W, 3).

        Raises
        ------
        InvalidImageError
            The image is not of the calibrated size.
        """
        expected = (self.intrinsics.height, self.intrinsics.width, 3)
        if np.shape(rgb) != expected:
            raise InvalidImageError(f"the calibrated camera takes pictures of shape {expected}; got {np.shape(rgb)}")
        return np.asarray(cv2.undistort(rgb, self.intrinsics.matrix, self.distortion), np.uint8)

    def undistort_pixels(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Pixels ``(u, v)`` of the pinhole camera, shape (..., 2).

        Parameters
        ----------
        pixels
            Pixels ``(u, v)`` in images from the lens, shape (..., 2).
        """
        pixels = np.asarray(pixels, float)
        k = self.intrinsics.matrix
        flat = cv2.undistortPoints(pixels.reshape(-1, 1, 2), k, self.distortion, P=k)
        return np.asarray(flat, float).reshape(pixels.shape)


@checked
def calibrate(pictures: Iterable[NDArray[np.uint8]], corners: tuple[int, int], square: float = 1.0) -> Calibration:
    """Calibrate a camera from pictures of a flat chessboard (Zhang's method, in OpenCV).

    Parameters
    ----------
    pictures
        RGB images of one size, uint8 (H, W, 3), with the board tilted by 20 degrees and more to different sides and,
        over all pictures, in every part of the image. Ten to twenty are enough; one without the whole board is skipped.
    corners
        Number of inner corners in a row and in a column of the board: (9, 6) for 10 x 7 squares.
    square
        Side of a square, m; the intrinsics do not depend on it.

    Raises
    ------
    CalibrationError
        Fewer than three pictures show the board, or all from nearly the same side, which any focal length explains.

    Examples
    --------
    A board of 10 x 7 squares, 20 pixels each, drawn as a known camera sees it from six random sides:

    >>> from gvp_lib import VirtualSphere
    >>> board = np.pad(255 * np.kron(np.indices((7, 10)).sum(axis=0) % 2, np.ones((20, 20))), 20, constant_values=255)
    >>> rgb = np.stack([board.astype(np.uint8)] * 3, axis=-1)
    >>> camera = CameraIntrinsics(640, 480, 530, 530, 319.5, 239.5)
    >>> camera_from_board = VirtualSphere((120, 90, 0), 300, pole=(0, 0, -1)).random(6, rng=0).inv()
    >>> homographies = camera.matrix @ np.delete(camera_from_board.as_matrix()[:, :3], 2, axis=2)
    >>> pictures = [cv2.warpPerspective(rgb, h, (640, 480), borderValue=(255, 255, 255)) for h in homographies]
    >>> lens = calibrate(pictures, corners=(9, 6)).intrinsics
    >>> bool(abs(lens.fx - camera.fx) < 1)
    True
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
    shape: tuple[int, ...] = ()
    n = 0
    for n, picture in enumerate(pictures, start=1):
        own = picture.shape if isinstance(picture, np.ndarray) and picture.dtype == np.uint8 else ()
        shape = shape or own
        if own != shape or own[2:] != (3,):
            given = f"{picture.dtype} {picture.shape}" if isinstance(picture, np.ndarray) else type(picture).__name__
            raise InvalidImageError(
                f"pictures are RGB images of one camera, uint8 (H, W, 3), all of one size; number {n} is {given}"
                + (f", those before {shape}" if n > 1 else "")
            )
        gray = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
        seen, at = cv2.findChessboardCornersSB(gray, corners, flags=cv2.CALIB_CB_ACCURACY)
        if seen:
            found.append(np.asarray(at, np.float32).reshape(-1, 2))
            used.append(n - 1)
    if len(found) < _MIN_SAMPLES:
        raise CalibrationError(
            f"{len(found)} of {n} pictures showed a board of {corners[0]} x {corners[1]} inner corners; at least "
            f"{_MIN_SAMPLES} must. Count inner corners, not squares; show the whole board with a white margin"
        )
    size = shape[1], shape[0]
    rms, k, distortion, rotations, _, deviation, *_ = cv2.calibrateCameraExtended(
        [board] * len(found), found, size, np.zeros((3, 3)), np.zeros(5)
    )
    normals = Rotation.from_rotvec(np.array(rotations, float).reshape(-1, 3)).apply((0, 0, 1))  # (n, 3)
    tilt = np.arccos(np.clip((normals @ normals.T).min(), -1, 1))
    if not np.isfinite(k).all() or tilt < _MIN_TILT:
        raise CalibrationError(
            f"{len(found)} pictures showed the board, but within {np.degrees(tilt):.1f} degrees of parallel, which "
            "any focal length explains. Take some with the board tilted by 30 degrees, about either axis"
        )
    intrinsics = CameraIntrinsics(*size, *(float(x) for x in (k[0, 0], k[1, 1], k[0, 2], k[1, 2])))
    return Calibration(
        intrinsics,
        np.array(distortion, float).ravel()[:5],
        float(rms),
        np.array(deviation, float).ravel()[:2],
        tuple(used),
    )


@dataclass(frozen=True, eq=False)
class HandEye:
    """Pose of a camera in the hand, by hand-eye calibration.

    Attributes
    ----------
    hand_from_camera
        Pose of the optical frame in the hand's frame, which is the frame whose pose the controller reports.
    base_from_board
        Pose of the board in the arm's base frame.
    shift_rms, turn_rms
        Root-mean-square distance, m, and angle, rad, between that pose and the board's pose according to each picture.
        A good arm and lens leave less than 1 mm and 0.2 deg; more points to a wrong square size, a board that moved, a
        bad lens, or poses in another convention than the controller's.
    """

    hand_from_camera: RigidTransform
    base_from_board: RigidTransform
    shift_rms: float
    turn_rms: float

    def __repr__(self) -> str:
        x, y, z = 1000 * self.hand_from_camera.translation
        angle = np.degrees(self.hand_from_camera.rotation.magnitude())
        return (
            f"HandEye(camera at ({x:.1f}, {y:.1f}, {z:.1f}) mm in the hand, rotated by {angle:.1f} deg, "
            f"rms {1000 * self.shift_rms:.2g} mm and {np.degrees(self.turn_rms):.2g} deg)"
        )


@checked(poses=True)
def calibrate_hand_eye(base_from_hand: RigidTransform, camera_from_board: RigidTransform) -> HandEye:
    """Estimate the pose of a camera in the hand from pictures of a board at rest.

    Parameters
    ----------
    base_from_hand
        Poses of the hand as the controller reports them, n in one ``RigidTransform`` (``RigidTransform.concatenate``).
        Ten to fifteen are enough, rotated by 30 degrees and more about at least two axes.
    camera_from_board
        Poses of the board in the n pictures taken there: ``cv2.findChessboardCornersSB`` finds its corners in an
        undistorted picture, and ``cv2.solvePnP`` its pose, as a rotation vector and a translation.

    Raises
    ------
    InvalidParameterError
        The two differ in number, or are single poses.
    CalibrationError
        There are fewer than three pairs, or the hand rotated about one axis only, so that the camera's position along
        that axis shows in no picture.

    Notes
    -----
    This solves A X = X B: the rotation in closed form (Park and Martin, 1994), then both poses by least squares.

    Examples
    --------
    Recover a known camera from a hand that tilts and rolls above a board:

    >>> from gvp_lib import VirtualSphere
    >>> hand_from_camera = RigidTransform.from_translation([0.0, -0.06, 0.02])
    >>> base_from_board = RigidTransform.from_translation([0.5, 0.0, 0.0])
    >>> base_from_camera = VirtualSphere((0.5, 0.0, 0.0), 0.4).random(12, 0)
    >>> found = calibrate_hand_eye(base_from_camera * hand_from_camera.inv(), base_from_camera.inv() * base_from_board)
    >>> bool(np.allclose(found.hand_from_camera.as_matrix(), hand_from_camera.as_matrix()))
    True
    """
    if base_from_hand.single or camera_from_board.single or len(base_from_hand) != len(camera_from_board):
        counts = " and ".join("1" if t.single else str(len(t)) for t in (base_from_hand, camera_from_board))
        raise InvalidParameterError(
            f"hand-eye calibration takes as many poses of the hand as of the board; got {counts}. "
            "RigidTransform.concatenate(list) makes one of many"
        )
    if len(base_from_hand) < _MIN_SAMPLES:
        raise CalibrationError(
            f"{_MIN_SAMPLES} pairs of poses are the least, and ten are wise; got {len(base_from_hand)}"
        )
    i, j = np.array(list(combinations(range(len(base_from_hand)), 2))).T
    hands = base_from_hand[i].inv() * base_from_hand[j]  # A: the hand's motion, in its first frame
    cameras = camera_from_board[i] * camera_from_board[j].inv()  # B: the camera's, in its own
    rotvecs = hands.rotation.as_rotvec()  # (pairs, 3)
    second = np.linalg.svd(rotvecs, compute_uv=False)[1] / np.sqrt(len(rotvecs))
    if second < _MIN_ROTATION / 2:
        raise CalibrationError(
            "the hand turned about one axis only, or hardly at all, so the camera's place along that axis shows in no "
            f"picture. Tilt it by 20 degrees and more to either side, and roll it too; about a second axis it turned "
            f"by {np.degrees(second):.1f} deg in the mean"
        )
    turn, _ = Rotation.align_vectors(rotvecs, cameras.rotation.as_rotvec())
    # (R_A - 1) t_X = R_X t_B - t_A, stacked over all pairs.
    left = (hands.rotation.as_matrix() - np.eye(3)).reshape(-1, 3)
    right = (turn.apply(cameras.translation) - hands.translation).ravel()
    shift, *_ = np.linalg.lstsq(left, right)
    start = RigidTransform.from_components(shift, turn)
    board = (base_from_hand * start * camera_from_board).mean()

    def residuals(x: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far each picture puts the board from where it is, with camera and board moved by ``x``."""
        camera, still = start * RigidTransform.from_exp_coords(x[:6]), board * RigidTransform.from_exp_coords(x[6:])
        error = still.inv() * (base_from_hand * camera * camera_from_board)
        return np.concatenate([error.translation.ravel(), _ROTATION_SCALE * error.rotation.as_rotvec().ravel()])

    best = least_squares(residuals, np.zeros(12)).x
    errors = residuals(best).reshape(2, -1, 3)
    shift_rms, turn_rms = np.sqrt((errors**2).sum(axis=2).mean(axis=1))
    return HandEye(
        start * RigidTransform.from_exp_coords(best[:6]),
        board * RigidTransform.from_exp_coords(best[6:]),
        float(shift_rms),
        float(turn_rms) / _ROTATION_SCALE,
    )
