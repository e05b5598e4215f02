"""Cameras and spheres: geometry without a simulator, a robot or an image."""

from gvp_lib.geometry.calibration import Calibration, HandEye, calibrate, calibrate_hand_eye
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.geometry.sphere import VirtualSphere, look_at

__all__ = ["Calibration", "CameraIntrinsics", "HandEye", "VirtualSphere", "calibrate", "calibrate_hand_eye", "look_at"]
