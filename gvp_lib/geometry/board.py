"""Boards to calibrate with (a chessboard, circles, OpenCV's ChArUco board), and where a picture shows one."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidImageError, InvalidParameterError

__all__ = ["Board", "Chessboard", "CircleGrid"]

# Half the window in which a corner is refined, in squares: as wide as may be without the next corner's edges, for the
# noise. The detector's own corners err together over a board of small squares, which no residual shows.
_WINDOW = 0.4
_REFINED = cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-4
_MOST = 100  # in a row: a finder's time grows with it
_MIN_CORNERS = 6  # of a board of markers seen in part: four give its pose, and two more can contradict it
_REFINING = cv2.aruco.DetectorParameters()
_REFINING.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX


def _checked(owner: str, counts: tuple[int, int], least: int, side: float) -> tuple[int, int]:
    """Two whole numbers, whatever type they came in, of a board whose side is positive."""
    try:
        u, v = counts
        whole = int(u), int(v)
        valid = whole == (u, v) and least <= min(whole) and max(whole) <= _MOST and 0 < side < 1e3
    except (TypeError, ValueError, OverflowError):
        valid = False
    if not valid:
        raise InvalidParameterError(
            f"{owner}, ({least}, {least}) to ({_MOST}, {_MOST}), and their distance is positive, in meters, below "
            f"1000; got {counts!r} and {side!r}"
        )
    return whole


def _misfit(points: NDArray[np.float64], homography: Any, at: Any) -> float:
    """Largest distance of pixels from where a homography puts points, px."""
    seen = cv2.perspectiveTransform(points.reshape(-1, 1, 2), homography)
    return float(np.linalg.norm(seen.reshape(-1, 2) - np.reshape(at, (-1, 2)), axis=1).max())


@checked
@dataclass(frozen=True)
class Chessboard:
    """Flat chessboard with a white margin.

    Parameters
    ----------
    corners
        Number of *inner* corners in a row and in a column: (9, 6) for 10 x 7 squares. With an even and an odd number of
        squares, the board looks different upside down; with any other, a picture may be counted from the other end.
    square
        Side of a square, m.

    Examples
    --------
    >>> Chessboard((9, 6), square=0.025)
    Chessboard(corners=(9, 6), square=0.025)
    """

    corners: tuple[int, int]
    square: float = 1.0

    def __post_init__(self) -> None:
        text = "corners are the inner corners of a chessboard's row and column, one fewer than its squares either way"
        object.__setattr__(self, "corners", _checked(text, self.corners, 3, self.square))

    def _points(self) -> NDArray[np.float64]:
        return np.mgrid[: self.corners[0], : self.corners[1]].T.reshape(-1, 2) * float(self.square)

    def _pixels(self, gray: NDArray[np.uint8]) -> NDArray[np.float32] | None:
        seen, at = cv2.findChessboardCornersSB(gray, self.corners)
        if not seen:
            return None
        grid = np.reshape(at, (self.corners[1], self.corners[0], 2))
        square = min(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1))
        # OpenCV may take pieces of several rows for one, which is the image of no plane.
        homography, _ = cv2.findHomography(self._points(), np.reshape(at, (-1, 2)))
        if homography is None or _misfit(self._points(), homography, at) > square / 2:
            return None
        half = max(2, int(_WINDOW * square))
        at = cv2.cornerSubPix(gray, np.array(at, np.float32), (half, half), (-1, -1), _REFINED)
        return np.asarray(at, np.float32)


@checked
@dataclass(frozen=True)
class CircleGrid:
    """Flat grid of dark circles on white.

    A tilted circle's center is not quite the center of its image, so a chessboard is the more exact of the two; circles
    bear more blur.

    Parameters
    ----------
    circles
        Number of circles in a row and in a column. Of a staggered grid, OpenCV's is (4, 11).
    spacing
        Distance between neighboring rows, m; in a row, of a staggered grid, circles are twice as far apart.
    staggered
        Every second row is shifted by ``spacing`` (OpenCV's asymmetric grid). Such a grid looks different upside down;
        a plain one does not, and a picture may be counted from another corner.

    Examples
    --------
    >>> CircleGrid((4, 11), spacing=0.02, staggered=True)
    CircleGrid(circles=(4, 11), spacing=0.02, staggered=True)
    """

    circles: tuple[int, int]
    spacing: float = 1.0
    staggered: bool = False

    def __post_init__(self) -> None:
        text = "circles are the number of circles in a row and in a column of the grid"
        object.__setattr__(self, "circles", _checked(text, self.circles, 3, self.spacing))

    def _points(self) -> NDArray[np.float64]:
        points = np.mgrid[: self.circles[0], : self.circles[1]].T.reshape(-1, 2)
        if self.staggered:
            points[:, 0] = 2 * points[:, 0] + points[:, 1] % 2
        return points * float(self.spacing)

    def _pixels(self, gray: NDArray[np.uint8]) -> NDArray[np.float32] | None:
        options = cv2.SimpleBlobDetector.Params()
        # OpenCV's own, 5000 px, is too small for a sharp camera.
        options.maxArea = max(options.minArea, gray.size / np.prod(self.circles))
        kind = cv2.CALIB_CB_ASYMMETRIC_GRID if self.staggered else cv2.CALIB_CB_SYMMETRIC_GRID
        detector = cv2.SimpleBlobDetector.create(options)
        seen, at = cv2.findCirclesGrid(gray, self.circles, flags=kind, blobDetector=detector)
        return np.asarray(at, np.float32) if seen else None


Board: TypeAlias = Chessboard | CircleGrid | cv2.aruco.Board
"""A board of either class, or one of OpenCV's ``cv2.aruco``, ``CharucoBoard`` and ``GridBoard`` among them, of which a
picture may show a part."""


def as_board(board: Any, square: float = 1.0) -> Board:
    """Board as it comes, or the chessboard that a pair of numbers stands for."""
    if isinstance(board, Board):
        return board
    if isinstance(board, tuple | list | np.ndarray):
        return Chessboard(board, square)  # type: ignore[arg-type]
    raise InvalidParameterError(
        "a board is (9, 6), the inner corners of a chessboard, or a Chessboard, a CircleGrid, or OpenCV's "
        f"cv2.aruco.GridBoard or cv2.aruco.CharucoBoard; got {type(board).__name__}"
    )


def as_gray(picture: Any, name: str = "picture") -> NDArray[np.uint8]:
    """Picture in gray, from an array or a file; a file's pixels as the sensor had them, whatever its EXIF tag says."""
    if isinstance(picture, str | os.PathLike):
        # A camera turned upside down has its lens upside down: pictures turned upright are those of two lenses.
        file = os.fspath(picture)
        picture = cv2.imread(file, cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION)
        if picture is None:
            raise InvalidImageError(f"{name} is {file!r}, which is no file, or none that OpenCV reads")
    if isinstance(picture, np.ndarray) and picture.dtype == np.uint8 and picture.size:
        if picture.ndim == 2:
            return picture
        if picture.ndim == 3 and picture.shape[2] == 3:
            return np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), np.uint8)
    given = f"{picture.dtype} {picture.shape}" if isinstance(picture, np.ndarray) else type(picture).__name__
    raise InvalidImageError(f"a picture is RGB or gray, uint8 (H, W, 3) or (H, W), or a file's name; {name} is {given}")


Found: TypeAlias = tuple[NDArray[np.float32], NDArray[np.float32]]
"""Points of a board, m, (n, 3), from its middle, and the pixels (n, 2) where a picture shows them."""


def locate(gray: NDArray[np.uint8], board: Board) -> Found | None:
    """Points of the board, m, (n, 3), from its middle, and the pixels (n, 2) where the picture shows them, or None."""
    points: Any
    pixels: Any
    if isinstance(board, cv2.aruco.CharucoBoard):
        whole = np.array(board.getChessboardCorners(), float)
        pixels, ids, *_ = cv2.aruco.CharucoDetector(board).detectBoard(gray)
        if ids is None or len(ids) < _MIN_CORNERS or board.checkCharucoCornersCollinear(ids):
            return None
        points = whole[np.ravel(ids)]
    elif isinstance(board, cv2.aruco.Board):
        whole = np.array(board.getObjPoints(), float).reshape(-1, 3)
        corners, ids, _ = cv2.aruco.ArucoDetector(board.getDictionary(), _REFINING).detectMarkers(gray)
        points, pixels = (None, None) if ids is None else board.matchImagePoints(corners, ids)
        if points is None or len(points) < _MIN_CORNERS:
            return None
    else:
        points = whole = np.pad(board._points(), ((0, 0), (0, 1)))
        pixels = board._pixels(gray)
        if pixels is None:
            return None
    # From the middle, an error of rotation shifts the board least.
    points = np.reshape(points, (-1, 3)) - (whole.min(axis=0) + whole.max(axis=0)) / 2
    return points.astype(np.float32), np.asarray(pixels, np.float32).reshape(-1, 2)
