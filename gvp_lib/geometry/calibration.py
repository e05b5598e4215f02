"""Calibration from images of a flat board: of the lens, and of the camera's pose in the hand.

The thesis calibrates the lens alone, because its planner rotates the wrist about the lens by what it sees. An adapter
for a real arm also needs the camera's pose in the hand: :meth:`gvp_lib.EyeInHandArm.camera_pose` is the pose of the
lens, and a robot's controller reports that of its flange.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import combinations
from reprlib import repr as brief
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import checked
from gvp_lib.errors import CalibrationError, InvalidImageError, InvalidParameterError
from gvp_lib.geometry.board import Board, Chessboard, Found, as_board, as_gray, locate
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.picture import Pictured, count

__all__ = ["Calibration", "HandEye", "board_pose", "calibrate", "calibrate_hand_eye"]

_MIN_SAMPLES = 3  # pictures of the board, and pairs of poses
# Pictures of parallel boards fit any focal length, and the fit's own standard deviation does not show it.
_MIN_TILT = np.radians(10)  # between the two boards that differ most
_MIN_ROTATION = np.radians(10)  # of the hand, about each of two axes
_ROTATION_SCALE = 0.3  # m/rad: weighs the board's rotation against its translation
_OUTLIER, _SMALLEST_OUTLIER = 6.0, 1e-3  # times the median picture's error, and m: gross errors only
_FAR = 1e6  # m; no place of a board or a hand
_FOLDED = 0.05  # share of the picture beyond which the fitted lens is none
_WIDE = 0.9  # focal lengths from the center to the image's corner: a fisheye of 103 degrees
_SIGNIFICANT = 5.0  # standard deviations
# Radial coefficients, by their places. Where the board was in the middle, noise alone can bend the rays outside of it
# wildly; those that the corners do not call for go then, the last first.
_DISPENSABLE = (cv2.CALIB_FIX_K3, 4), (cv2.CALIB_FIX_K2, 1), (cv2.CALIB_FIX_K1, 0)
_COVERED, _BENT = 0.4, 0.15  # shares: of the picture, and of a pixel's way from the center by which it is moved


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
        Root-mean-square reprojection error of the corners, px. A sharp camera leaves 0.05 to 0.3; more points to blur,
        to a board that is not flat, or to pictures turned upside down. A small one says nothing about parts of the
        image where no picture showed the board.
    focal_deviation
        Standard deviation of (fx, fy) that follows from this error, px, shape (2,), read-only.
    used
        Indices of the pictures that showed the board, from 0.
    coverage
        Share of the image within the outline of all corners found. Beyond it, the distortion is a guess: trust no pixel
        there.
    """

    _figure = "plot_calibration"

    intrinsics: CameraIntrinsics
    distortion: NDArray[np.float64]
    rms_px: float
    focal_deviation: NDArray[np.float64]
    used: tuple[int, ...]
    coverage: float = np.nan

    def __post_init__(self) -> None:
        for name in ("distortion", "focal_deviation"):
            array = np.array(getattr(self, name), float).ravel()
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    def __repr__(self) -> str:
        lens, (sx, sy) = self.intrinsics, self.focal_deviation
        where = f"{count(len(self.used), 'picture')} over {100 * self.coverage:.0f} % of the image"
        return (
            f"Calibration({lens.width} x {lens.height} px, fx {lens.fx:.1f} (sd {sx:.2g}) px, "
            f"fy {lens.fy:.1f} (sd {sy:.2g}) px, rms {self.rms_px:.2g} px, {where})"
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
        if not isinstance(rgb, np.ndarray) or rgb.dtype != np.uint8 or rgb.shape != expected:
            given = f"{rgb.shape} of {rgb.dtype}" if isinstance(rgb, np.ndarray) else type(rgb).__name__
            raise InvalidImageError(f"the calibrated camera takes uint8 pictures of shape {expected}; got {given}")
        return np.asarray(cv2.undistort(rgb, self.intrinsics.matrix, self.distortion), np.uint8)

    def undistort_pixels(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Pixels ``(u, v)`` of the pinhole camera, shape (..., 2).

        Parameters
        ----------
        pixels
            Pixels ``(u, v)`` in images from the lens, shape (..., 2).
        """
        pixels = np.asarray(pixels, float)
        if pixels.ndim == 0 or pixels.shape[-1] != 2:
            raise InvalidParameterError(f"pixels (u, v) have shape (..., 2); got {pixels.shape}")
        if not pixels.size:
            return pixels
        k = self.intrinsics.matrix
        flat = cv2.undistortPoints(pixels.reshape(-1, 1, 2), k, self.distortion, P=k)
        return np.asarray(flat, float).reshape(pixels.shape)


@checked(own=True)
def calibrate(
    pictures: Iterable[NDArray[np.uint8] | str | os.PathLike[str]],
    board: Board | tuple[int, int] | None = None,
    square: float = 1.0,
    *,
    corners: tuple[int, int] | None = None,
) -> Calibration:
    """Calibrate a camera from pictures of a flat board (Zhang's method, in OpenCV).

    Parameters
    ----------
    pictures
        Pictures of one size, or their files: uint8 (H, W, 3), RGB, or (H, W), with the board tilted by 20 degrees and
        more to different sides and, over all pictures, in every part of the image, its edges too. Ten to twenty are
        enough; one that does not show the board is skipped. Files are read as the sensor took them, not turned by their
        EXIF tag, because a turned picture is that of another lens. ``cv2.imread`` turns, unless it is given
        ``cv2.IMREAD_IGNORE_ORIENTATION``.
    board
        Inner corners in a row and in a column of a chessboard: (9, 6) for 10 x 7 squares. Or a :class:`Chessboard`, a
        :class:`CircleGrid`, or OpenCV's ``cv2.aruco.CharucoBoard``, which need not be seen whole.
    square
        Side of a square of a chessboard that is given by its corners, m; the intrinsics do not depend on it.
    corners
        Another name of ``board``.

    Raises
    ------
    CalibrationError
        Fewer than three pictures show the board, or all from nearly the same side, which any focal length explains. Or
        a strong distortion is not determined in the outer part of the image: the board was in the middle only, or the
        lens is a fisheye (120 degrees and more), for which ``cv2.fisheye`` has a model.

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
    >>> lens = calibrate(pictures, (9, 6)).intrinsics
    >>> bool(abs(lens.fx - camera.fx) < 1)
    True
    """
    board = as_board(corners if board is None else board, square)
    one = isinstance(pictures, str | os.PathLike) or (isinstance(pictures, np.ndarray) and pictures.shape[2:] == (3,))
    if one or not isinstance(pictures, Iterable):
        raise InvalidImageError(f"pictures are several, or their files, in a list; got {type(pictures).__name__}")
    found: dict[int, Found] = {}
    shape: tuple[int, ...] = ()
    n = 0
    for n, picture in enumerate(pictures, start=1):
        gray = as_gray(picture, f"number {n}")
        shape = shape or gray.shape
        if gray.shape != shape:
            turned = "; a photograph turned by its EXIF tag is so: read it with cv2.IMREAD_IGNORE_ORIENTATION"
            raise InvalidImageError(
                f"pictures are those of one camera, all of one size (H, W); number {n} is {gray.shape}, those before "
                f"{shape}{turned if gray.shape == shape[::-1] else ''}"
            )
        if (seen := locate(gray, board)) is not None:
            found[n - 1] = seen
    if len(found) < _MIN_SAMPLES:
        raise CalibrationError(
            f"{len(found)} of {n} pictures showed {_named(board)}; at least {_MIN_SAMPLES} must. Count a chessboard's "
            "inner corners, not its squares. Show the whole board, or much of a ChArUco board, with a white margin"
        )
    return fit_lens(found, (shape[1], shape[0]))


def fit_lens(found: Mapping[int, Found], size: tuple[int, int]) -> Calibration:
    """Lens from where three pictures or more, by number, showed a board, as :func:`locate` found it; size in px."""
    used, (points, pixels) = tuple(found), zip(*found.values(), strict=True)
    coverage = cv2.contourArea(cv2.convexHull(np.concatenate(pixels))) / (size[0] * size[1])
    flags = 0
    for fixed, place in (*_DISPENSABLE, (0, 0)):
        with _one_thread():
            rms, k, bent, rotations, _, deviation, *_ = cv2.calibrateCameraExtended(
                points, pixels, size, np.zeros((3, 3)), np.zeros(5), flags=flags
            )
        normals = Rotation.from_rotvec(np.array(rotations, float).reshape(-1, 3)).apply((0, 0, 1))  # (n, 3)
        tilt = np.arccos(np.clip((normals @ normals.T).min(), -1, 1))
        if not np.isfinite(k).all() or tilt < _MIN_TILT:
            raise CalibrationError(
                f"{len(used)} pictures showed the board, but within {np.degrees(tilt):.1f} degrees of parallel, which "
                "any focal length explains. Take some with the board tilted by 30 degrees, about either axis"
            )
        intrinsics = CameraIntrinsics(*size, *(float(x) for x in (k[0, 0], k[1, 1], k[0, 2], k[1, 2])))
        distortion, deviations = np.array(bent, float).ravel()[:5], np.array(deviation, float).ravel()
        calibration = Calibration(intrinsics, distortion, float(rms), deviations[:2], used, float(coverage))
        doubt = _doubt(calibration)
        if not doubt or not fixed or abs(distortion[place]) > _SIGNIFICANT * deviations[4 + place]:
            break
        flags |= fixed
    reach = (np.array(size) / 2 + abs(intrinsics.principal_point - np.array(size) / 2)) / (intrinsics.fx, intrinsics.fy)
    if doubt and np.linalg.norm(reach) > _WIDE:
        raise CalibrationError(
            f"the board covered {100 * coverage:.0f} % of the image, and beyond it so wide a lens is not determined: "
            f"as fitted, the image has {doubt}. Take pictures with the board at the image's edges, all around. If some "
            "are, the lens is a fisheye (120 degrees and more), no pinhole with a little distortion; cv2.fisheye has a "
            "model for it"
        )
    return calibration


@contextmanager
def _one_thread() -> Iterator[None]:
    """OpenCV on one thread: several add in the order in which they finish, and the lens differs from call to call."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def _doubt(calibration: Calibration) -> str:
    """What is wrong with a lens as fitted, outside of where the board was, or nothing."""
    lens, (k1, k2, _, _, k3) = calibration.intrinsics, calibration.distortion
    pixels = np.stack(np.meshgrid(*(np.linspace(-0.5, n - 0.5, 40) for n in (lens.width, lens.height))), axis=-1)
    seen = np.linalg.norm((pixels - lens.principal_point) / (lens.fx, lens.fy), axis=-1)  # (40, 40), focal lengths
    squares = np.roots([7 * k3, 5 * k2, 3 * k1, 1])  # of the radii at which the lens begins to bend rays back inward
    squares = squares.real[(abs(squares.imag) < 1e-9) & (squares.real > 0)]
    r2 = squares.min(initial=np.inf)
    last = np.sqrt(r2) * (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) if np.isfinite(r2) else np.inf
    folded = (seen > last).mean()
    if folded > _FOLDED:
        return f"no rays for its outer {100 * folded:.0f} %"
    ways = np.linalg.norm(calibration.undistort_pixels(pixels) - pixels, axis=-1)
    moved = (ways / np.linalg.norm(pixels - lens.principal_point, axis=-1)).max()
    if calibration.coverage < _COVERED and moved > _BENT:
        return f"pixels moved by {100 * moved:.0f} % of their way from the center"
    return ""


def _named(board: Board) -> str:
    if isinstance(board, cv2.aruco.CharucoBoard):
        return "a ChArUco board of {} x {} squares".format(*board.getChessboardSize())
    if isinstance(board, cv2.aruco.Board):
        return f"a board of {count(len(board.getIds()), 'marker')}"
    if isinstance(board, Chessboard):
        return "a board of {} x {} inner corners".format(*board.corners)
    return repr(board)


@checked(own=True)
def board_pose(
    picture: NDArray[np.uint8] | str | os.PathLike[str], board: Board, lens: Calibration | CameraIntrinsics
) -> RigidTransform | None:
    """Pose of a board in the camera that took a picture, ``camera_from_board``; None where it shows no board.

    The board's frame has its origin in the middle of its corners or circles, x along a row, y along a column, and z
    away from the camera.

    Parameters
    ----------
    picture
        Picture or its file: uint8 (H, W, 3), RGB, or (H, W).
    board
        A :class:`Chessboard`, a :class:`CircleGrid` or a ``cv2.aruco.CharucoBoard``, in meters.
    lens
        Calibrated lens, for a picture as it comes; or a pinhole, for one without distortion.

    Raises
    ------
    InvalidImageError
        The picture is not one, or not of the lens's size.

    Examples
    --------
    A board of 30 mm squares straight ahead, at 0.5 m, where a camera sees each 32 pixels wide:

    >>> from gvp_lib.geometry import Chessboard
    >>> squares = 255 * np.kron(np.indices((6, 9)).sum(axis=0) % 2, np.ones((32, 32)))
    >>> picture = np.pad(squares, ((144, 144), (176, 176)), constant_values=255).astype(np.uint8)
    >>> lens = CameraIntrinsics(640, 480, 533.3, 533.3, 319.5, 239.5)
    >>> board_pose(picture, Chessboard((8, 5), 0.03), lens).translation.round(3) + 0.0
    array([0. , 0. , 0.5])
    """
    if isinstance(board, tuple | list):
        raise InvalidParameterError(
            f"a pose needs the size of the squares, in meters: Chessboard({tuple(board)}, square=0.03); got {board}"
        )
    pinhole, distortion = (lens.intrinsics, lens.distortion) if isinstance(lens, Calibration) else (lens, None)
    board, gray = as_board(board), as_gray(picture)
    if gray.shape != (pinhole.height, pinhole.width):
        raise InvalidImageError(f"the lens takes pictures of shape {(pinhole.height, pinhole.width)}; got {gray.shape}")
    found = locate(gray, board)
    return None if found is None else pose_of(found, pinhole, distortion)


def pose_of(found: Found, pinhole: CameraIntrinsics, distortion: NDArray[np.float64] | None) -> RigidTransform:
    """``camera_from_board`` of a board that a picture showed, as :func:`locate` found it."""
    _, turn, shift = cv2.solvePnP(*found, pinhole.matrix, distortion)
    return RigidTransform.from_components(shift.ravel(), Rotation.from_rotvec(turn.ravel()))


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
        Root-mean-square distance, m, and angle, rad, between that pose and the board's pose according to each picture
        used. An accurate arm with a straightened lens leaves 1 mm and 0.2 deg; several millimeters are usual on others.
        Centimeters point to a wrong square size, a board that moved, a lens not straightened, or poses of the hand in
        another convention than the controller's.
    shifts, turns
        This distance and angle in each picture, shape (n,), read-only.
    used
        Indices of the pictures that agree, from 0. Others disagree with them by far more than these do with each other:
        a board counted from its other end, a picture of another moment. Only ``shifts`` and ``turns`` have them.
    """

    hand_from_camera: RigidTransform
    base_from_board: RigidTransform
    shift_rms: float
    turn_rms: float
    shifts: NDArray[np.float64]
    turns: NDArray[np.float64]
    used: tuple[int, ...]

    def __post_init__(self) -> None:
        for name in ("shifts", "turns"):
            array = np.array(getattr(self, name), float)
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def outliers(self) -> tuple[int, ...]:
        """Indices of the pictures left out, from 0."""
        return tuple(k for k in range(len(self.shifts)) if k not in self.used)

    def __repr__(self) -> str:
        x, y, z = 1000 * self.hand_from_camera.translation
        angle = np.degrees(self.hand_from_camera.rotation.magnitude())
        out = [f"{k} ({1000 * self.shifts[k]:.0f} mm, {np.degrees(self.turns[k]):.0f} deg)" for k in self.outliers]
        more = f" and {len(out) - 1} more" if len(out) > 1 else ""
        return (
            f"HandEye(camera at ({x:.1f}, {y:.1f}, {z:.1f}) mm in the hand, rotated by {angle:.1f} deg, "
            f"rms {1000 * self.shift_rms:.2g} mm and {np.degrees(self.turn_rms):.2g} deg"
            + (f"; left out: {out[0]}{more})" if out else ")")
        )


def _poses(poses: Any, name: str) -> RigidTransform:
    """Several poses in one ``RigidTransform``, from any form that can mean only one thing."""
    try:
        found = _as_transform(poses)
    except (TypeError, ValueError):
        found = None
    if found is None or found.single or not (abs(found.translation) < _FAR).all():
        raise InvalidParameterError(
            f"{name} takes several poses: a RigidTransform, a list of them, an array (n, 4, 4), or OpenCV's pair of n "
            "rotations, as matrices or as rotation vectors, and n translations, all finite; "
            f"got {'one pose' if found is not None and found.single else brief(poses)}"
        )
    return found


def _as_transform(poses: Any) -> RigidTransform | None:
    """Poses of any form, or None of what is no rigid motion."""
    if isinstance(poses, RigidTransform):
        return poses
    poses = list(poses)
    if poses and all(isinstance(pose, RigidTransform) for pose in poses):
        return RigidTransform.concatenate(poses)
    if len(poses) == 2 and np.shape(poses[0]) != (4, 4):
        turns, shifts = (_floats(each) for each in poses)
    elif all(len(pose) == 2 for pose in poses):
        turns, shifts = (_floats(each) for each in zip(*poses, strict=True))
    else:
        matrices = _floats(poses)
        if matrices.shape[1:] != (4, 4) or not (matrices[:, 3] == (0, 0, 0, 1)).all():
            return None
        turns, shifts = matrices[:, :3, :3], matrices[:, :3, 3]
    if turns.size == 3 * len(turns):  # vectors, as cv2.solvePnP gives them; may be columns
        turns = Rotation.from_rotvec(turns.reshape(-1, 3)).as_matrix()
    shifts = shifts.reshape(len(turns), 3)
    if not ((abs(turns) < 1.1).all() and np.allclose(turns @ turns.mT, np.eye(3), atol=0.01)):
        return None
    if not (np.linalg.det(turns) > 0).all():
        return None
    return RigidTransform.from_components(shifts, Rotation.from_matrix(turns.reshape(-1, 3, 3)))


def _floats(values: Any) -> NDArray[np.float64]:
    array = np.array(values)
    if array.dtype.kind not in "iuf":
        raise TypeError
    return array.astype(float)


def _hand_eye(hands: RigidTransform, boards: RigidTransform) -> tuple[RigidTransform, RigidTransform]:
    """Camera in the hand and board in the base that explain all pictures best."""
    i, j = np.array(list(combinations(range(len(hands)), 2))).T
    moved = hands[i].inv() * hands[j]  # A: the hand's motion, in its first frame
    seen = boards[i] * boards[j].inv()  # B: the camera's, in its own
    rotvecs = moved.rotation.as_rotvec()  # (pairs, 3)
    second = np.linalg.svd(rotvecs, compute_uv=False)[1] / np.sqrt(len(rotvecs))
    if second < _MIN_ROTATION / 2:
        raise CalibrationError(
            "the hand turned about one axis only, or hardly at all, so the camera's place along that axis shows in no "
            f"picture. Tilt it by 20 degrees and more to either side, and roll it too; about a second axis it turned "
            f"by {np.degrees(second):.1f} deg in the mean"
        )
    turn, _ = Rotation.align_vectors(rotvecs, seen.rotation.as_rotvec())
    # (R_A - 1) t_X = R_X t_B - t_A, stacked over all pairs.
    left = (moved.rotation.as_matrix() - np.eye(3)).reshape(-1, 3)
    right = (turn.apply(seen.translation) - moved.translation).ravel()
    shift, *_ = np.linalg.lstsq(left, right)
    camera = RigidTransform.from_components(shift, turn)
    board = (hands * camera * boards).mean()

    def residuals(x: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far each picture puts the board from where it is, with camera and board moved by ``x``."""
        at, still = camera * RigidTransform.from_exp_coords(x[:6]), board * RigidTransform.from_exp_coords(x[6:])
        return np.concatenate([each.ravel() for each in _errors(hands, boards, at, still)])

    best = least_squares(residuals, np.zeros(12)).x
    return camera * RigidTransform.from_exp_coords(best[:6]), board * RigidTransform.from_exp_coords(best[6:])


def _errors(
    hands: RigidTransform, boards: RigidTransform, camera: RigidTransform, board: RigidTransform
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Shift and scaled turn, m, (n, 3) each, from the board to where each picture puts it."""
    error = board.inv() * (hands * camera * boards)
    return error.translation, _ROTATION_SCALE * error.rotation.as_rotvec()


def _agreeing(errors: NDArray[np.float64], used: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pictures without a gross error beside those used; all, unless they are the most and enough."""
    agreeing = errors <= max(_OUTLIER * float(np.median(errors[used])), _SMALLEST_OUTLIER)
    enough = agreeing.sum() >= _MIN_SAMPLES and 2 * agreeing.sum() > len(errors)
    return agreeing if enough else np.ones(len(errors), bool)


def _disagreement(hands: RigidTransform, boards: RigidTransform) -> NDArray[np.float64]:
    """How ill each picture goes with the median other one, m, (n,), whatever the camera's pose.

    Hand and camera are one rigid body: between two pictures, both turn by one angle, and move by one length along the
    axis they turn about.
    """
    i, j = np.triu_indices(len(hands), 1)
    angles, slides = [], []
    for motion in (hands[i].inv() * hands[j], boards[i] * boards[j].inv()):
        rotvecs = motion.rotation.as_rotvec()
        angle = np.linalg.norm(rotvecs, axis=1)
        angles.append(angle)
        slides.append((rotvecs * motion.translation).sum(axis=1) / np.maximum(angle, 1e-9))
    table = np.full((len(hands), len(hands)), np.nan)
    table[i, j] = table[j, i] = np.hypot(slides[0] - slides[1], _ROTATION_SCALE * (angles[0] - angles[1]))
    return np.asarray(np.nanmedian(table, axis=1), float)


@checked
def calibrate_hand_eye(base_from_hand: Any, camera_from_board: Any) -> HandEye:
    """Estimate the pose of a camera in the hand from pictures of a board at rest.

    Parameters
    ----------
    base_from_hand
        Poses of the hand as the controller reports them, n of them: a ``RigidTransform`` of n poses, a list of single
        ones, an array (n, 4, 4), or OpenCV's pair of n rotations (matrices, or rotation vectors) and n translations.
        Ten to fifteen are enough, rotated by 30 degrees and more about at least two axes.
    camera_from_board
        Poses of the board in the n pictures taken there, in any of these forms: :func:`board_pose` finds them.

    Raises
    ------
    InvalidParameterError
        The two differ in number, or are not poses.
    CalibrationError
        There are fewer than three pairs, or the hand rotated about one axis only, so that the camera's position along
        that axis shows in no picture.

    Notes
    -----
    This solves A X = X B: the rotation in closed form (Park and Martin, 1994), then both poses by least squares.
    Pictures with gross errors are found first, by what A and B have in common whatever X is, and left out.

    The poses of the hand inverted, or those of the board, leave decimeters. *Both* inverted leave nothing, and
    ``hand_from_camera`` is then the board's pose in the base: hold a ruler beside the answer. The two are what
    ``cv2.calibrateHandEye`` calls gripper2base and target2cam.

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
    hands, boards = _poses(base_from_hand, "base_from_hand"), _poses(camera_from_board, "camera_from_board")
    if len(hands) != len(boards):
        raise InvalidParameterError(
            "hand-eye calibration takes as many poses of the hand as of the board, those of the same pictures; "
            f"got {len(hands)} and {len(boards)}"
        )
    if len(hands) < _MIN_SAMPLES:
        raise CalibrationError(f"{_MIN_SAMPLES} pairs of poses are the least, and ten are wise; got {len(hands)}")
    everything = np.ones(len(hands), bool)
    used = _agreeing(_disagreement(hands, boards), everything)
    for _ in range(len(hands)):
        camera, board = _hand_eye(hands[used], boards[used])
        shifts, turns = (np.linalg.norm(each, axis=1) for each in _errors(hands, boards, camera, board))
        agreeing = _agreeing(np.hypot(shifts, turns), used)
        if (agreeing == used).all():
            break
        used = agreeing
    shift_rms, turn_rms = np.sqrt([(shifts[used] ** 2).mean(), (turns[used] ** 2).mean()])
    return HandEye(
        camera,
        board,
        float(shift_rms),
        float(turn_rms) / _ROTATION_SCALE,
        shifts,
        turns / _ROTATION_SCALE,
        tuple(np.flatnonzero(used).tolist()),
    )
