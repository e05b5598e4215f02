"""Calibration from pictures of a board: the lens, which is all that the thesis calibrates, and the camera in the hand.

The thesis's planner does without the second, for it turns the wrist about the lens by what it sees. A real adapter
needs it all the same: :meth:`gvp_lib.EyeInHandArm.camera_pose` is about the lens, and a robot's controller about its
flange.
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

from gvp_lib.errors import CalibrationError, InvalidImageError, InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics

__all__ = ["Calibration", "HandEye", "calibrate", "calibrate_hand_eye"]

_LEAST = 3  # pictures of the board, and pairs of poses
# Pictures of parallel boards fit any focal length, and the fit's own standard deviation does not betray it.
_LEAST_TILT = np.radians(10)  # the most that two pictures' boards must differ by
_LEAST_TURN = np.radians(10)  # by which the hand must turn about two axes
_LEVER = 0.3  # m: a radian of the board's turn counts as so much of its shift


@dataclass(frozen=True, eq=False)
class Calibration:
    """Lens of a camera: pinhole and distortion.

    Attributes
    ----------
    intrinsics
        Pinhole; it also holds for pictures from :meth:`undistort`.
    distortion
        OpenCV's k1, k2, p1, p2, k3, shape (5,), read-only.
    rms_px
        Root mean square distance of the corners found from where the lens puts them, px. A small one (below 0.5) says
        nothing of where no picture showed the board.
    focal_deviation
        Standard deviation of (fx, fy) by that distance, shape (2,), px, read-only.
    used
        Indices of the pictures that showed the board, from 0.
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
        """Picture of a pinhole with ``intrinsics``, uint8 (H, W, 3); black where the lens saw nothing."""
        expected = (self.intrinsics.height, self.intrinsics.width, 3)
        if np.shape(rgb) != expected:
            raise InvalidImageError(f"the calibrated camera takes pictures of shape {expected}; got {np.shape(rgb)}")
        return np.asarray(cv2.undistort(rgb, self.intrinsics.matrix, self.distortion), np.uint8)

    def undistort_pixels(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Pixels of the pinhole for the lens's ``pixels``, both ``(u, v)``, shape (..., 2)."""
        pixels = np.asarray(pixels, float)
        k = self.intrinsics.matrix
        flat = cv2.undistortPoints(pixels.reshape(-1, 1, 2), k, self.distortion, P=k)
        return np.asarray(flat, float).reshape(pixels.shape)


def calibrate(pictures: Iterable[NDArray[np.uint8]], corners: tuple[int, int], square: float = 1.0) -> Calibration:
    """Calibrate a camera from pictures of one flat chessboard (Zhang's method, in OpenCV).

    Parameters
    ----------
    pictures
        RGB uint8 (H, W, 3), all of one size, of the board from different sides, tilted by 20 degrees and more, and
        together filling the image. Ten to twenty are enough; one that does not show the whole board is skipped.
    corners
        Inner corners in a row and in a column of the board: (9, 6) for 10 x 7 squares.
    square
        Side of a square, m; the intrinsics do not depend on it.

    Raises
    ------
    CalibrationError
        Fewer than three pictures show the board, or all from nearly the same side, which any focal length explains.
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
    if len(found) < _LEAST:
        raise CalibrationError(
            f"{len(found)} of {n} pictures showed a board of {corners[0]} x {corners[1]} inner corners; at least "
            f"{_LEAST} must. Count inner corners, not squares; show the whole board with a white margin"
        )
    size = shape[1], shape[0]
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
        intrinsics,
        np.array(distortion, float).ravel()[:5],
        float(rms),
        np.array(deviation, float).ravel()[:2],
        tuple(used),
    )


@dataclass(frozen=True, eq=False)
class HandEye:
    """Place of a camera in the hand.

    Attributes
    ----------
    hand_from_camera
        Pose of the optical frame in the hand's frame, the one whose pose the controller reports.
    base_from_board
        Pose of the board.
    shift_rms, turn_rms
        Root mean square distance and angle between that pose and where each picture puts the board, m and rad. A good
        arm and lens leave less than 1 mm and 0.2 deg; more comes from a wrong square size, a board that moved, a bad
        lens, or poses in another convention than the controller's.
    """

    hand_from_camera: RigidTransform
    base_from_board: RigidTransform
    shift_rms: float
    turn_rms: float


def calibrate_hand_eye(base_from_hand: RigidTransform, camera_from_board: RigidTransform) -> HandEye:
    """Solve A X = X B: rotation in closed form (Park and Martin, 1994), then all of it by least squares.

    Parameters
    ----------
    base_from_hand
        Poses of the hand as the controller reports them, n in one ``RigidTransform`` (``RigidTransform.concatenate``).
    camera_from_board
        Poses of the board in the pictures that were taken there, n as well: ``cv2.findChessboardCornersSB`` finds
        its corners in a straightened picture, and ``cv2.solvePnP`` its pose, as a rotation vector and a shift.
        Ten to fifteen pairs are enough, from hands turned by 30 degrees and more, about at least two axes.

    Raises
    ------
    InvalidParameterError
        The two are not as many, or single poses.
    CalibrationError
        Fewer than three pairs, or a hand that turned about one axis only: the camera's place along that axis then
        shows in no picture.

    Examples
    --------
    A hand that is tilted and rolled above a board finds the camera that we put into it:

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
    if len(base_from_hand) < _LEAST:
        raise CalibrationError(f"{_LEAST} pairs of poses are the least, and ten are wise; got {len(base_from_hand)}")
    i, j = np.array(list(combinations(range(len(base_from_hand)), 2))).T
    hands = base_from_hand[i].inv() * base_from_hand[j]  # A: the hand's motion, in its first frame
    eyes = camera_from_board[i] * camera_from_board[j].inv()  # B: the camera's, in its own
    turns = hands.rotation.as_rotvec()  # (pairs, 3)
    second = np.linalg.svd(turns, compute_uv=False)[1] / np.sqrt(len(turns))
    if second < _LEAST_TURN / 2:
        raise CalibrationError(
            "the hand turned about one axis only, or hardly at all, so the camera's place along that axis shows in no "
            f"picture. Tilt it by 20 degrees and more to either side, and roll it too; about a second axis it turned "
            f"by {np.degrees(second):.1f} deg in the mean"
        )
    turn, _ = Rotation.align_vectors(turns, eyes.rotation.as_rotvec())
    # (R_A - 1) t_X = R_X t_B - t_A, stacked over all pairs.
    left = (hands.rotation.as_matrix() - np.eye(3)).reshape(-1, 3)
    right = (turn.apply(eyes.translation) - hands.translation).ravel()
    shift, *_ = np.linalg.lstsq(left, right)
    start = RigidTransform.from_components(shift, turn)
    board = (base_from_hand * start * camera_from_board).mean()

    def left_over(x: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far each picture puts the board from where it is, with camera and board moved by ``x``."""
        camera, still = start * RigidTransform.from_exp_coords(x[:6]), board * RigidTransform.from_exp_coords(x[6:])
        error = still.inv() * (base_from_hand * camera * camera_from_board)
        return np.concatenate([error.translation.ravel(), _LEVER * error.rotation.as_rotvec().ravel()])

    best = least_squares(left_over, np.zeros(12)).x
    rest = left_over(best).reshape(2, -1, 3)
    shift_rms, turn_rms = np.sqrt((rest**2).sum(axis=2).mean(axis=1))
    return HandEye(
        start * RigidTransform.from_exp_coords(best[:6]),
        board * RigidTransform.from_exp_coords(best[6:]),
        float(shift_rms),
        float(turn_rms) / _LEVER,
    )
