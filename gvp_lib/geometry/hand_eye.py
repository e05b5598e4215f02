"""Where a camera sits in a robot's hand, from pictures of a board that stands still: hand-eye calibration.

The thesis does without, for its planner turns the wrist about the lens by what it sees. A real adapter needs it all the
same: :meth:`gvp_lib.EyeInHandArm.camera_pose` is about the lens, and a robot's controller tells about its flange.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import CalibrationError, InvalidParameterError

__all__ = ["HandEye", "calibrate_hand_eye"]

_LEAST_POSES = 3
_LEAST_TURN = np.radians(10)  # by which the hand must turn about two axes
_LEVER = 0.3  # m: a radian of the board's turn counts as so much of its shift


@dataclass(frozen=True, eq=False)
class HandEye:
    """A camera's place in the hand.

    Attributes
    ----------
    hand_from_camera
        The pose of the optical frame in the frame of the hand that the controller tells about.
    base_from_board
        Where the board stood.
    shift_rms, turn_rms
        Root mean square of what is left between where the board stood and where each picture puts it, m and rad.
        Of a good arm and lens: below 1 mm and 0.2 deg. A large one is a wrong square size, a board that moved, a bad
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
        Poses of the hand as the controller tells them, n of them in one ``RigidTransform``
        (``RigidTransform.concatenate``).
    camera_from_board
        Poses of the board in the pictures that were taken there, n as well: ``cv2.findChessboardCornersSB`` finds
        its corners in a straightened picture, and ``cv2.solvePnP`` its pose, as a rotation vector and a shift.
        Ten to fifteen pairs do, from hands turned by 30 degrees and more, about at least two axes.

    Raises
    ------
    InvalidParameterError
        The two are not as many, or single poses.
    CalibrationError
        There are fewer than three pairs, or the hand turned about one axis only: then the camera's place along that
        axis shows in no picture.

    Examples
    --------
    A hand that is tilted and rolled above a board, and a camera in it that we know, so as to know it again:

    >>> from gvp_lib.geometry.sphere import VirtualSphere
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
    if len(base_from_hand) < _LEAST_POSES:
        raise CalibrationError(
            f"{_LEAST_POSES} pairs of poses are the least, and ten are wise; got {len(base_from_hand)}"
        )
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
    return _refined(base_from_hand, camera_from_board, RigidTransform.from_components(shift, turn))


def _refined(hands: RigidTransform, boards: RigidTransform, start: RigidTransform) -> HandEye:
    """The camera's and the board's pose that agree best with all pictures."""
    board = (hands * start * boards).mean()

    def left(x: NDArray[np.float64]) -> NDArray[np.float64]:
        camera, still = start * RigidTransform.from_exp_coords(x[:6]), board * RigidTransform.from_exp_coords(x[6:])
        error = still.inv() * (hands * camera * boards)
        return np.concatenate([error.translation.ravel(), _LEVER * error.rotation.as_rotvec().ravel()])

    best = least_squares(left, np.zeros(12)).x
    rest = left(best).reshape(2, -1, 3)
    shift_rms, turn_rms = np.sqrt((rest**2).sum(axis=2).mean(axis=1))
    return HandEye(
        start * RigidTransform.from_exp_coords(best[:6]),
        board * RigidTransform.from_exp_coords(best[6:]),
        float(shift_rms),
        float(turn_rms) / _LEVER,
    )
