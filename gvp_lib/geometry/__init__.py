"""Geometry of the camera and of its viewpoints.

A pinhole camera (``CameraIntrinsics``), camera poses on a sphere about an object (``VirtualSphere``, ``look_at``), and
calibration from images of a board (``Chessboard``, ``CircleGrid``, ChArUco): of the lens (``calibrate``) and of the
camera's pose in the hand (``board_pose``, ``calibrate_hand_eye``). Poses are SciPy's ``RigidTransform``.
"""

from gvp_lib.geometry.board import Chessboard, CircleGrid
from gvp_lib.geometry.calibration import Calibration, HandEye, board_pose, calibrate, calibrate_hand_eye
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.geometry.sphere import VirtualSphere, look_at

__all__ = [
    "Calibration",
    "CameraIntrinsics",
    "Chessboard",
    "CircleGrid",
    "HandEye",
    "VirtualSphere",
    "board_pose",
    "calibrate",
    "calibrate_hand_eye",
    "look_at",
]
