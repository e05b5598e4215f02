"""Motion of a camera in a hand, without a simulator: everything here sees an arm only as an `EyeInHandArm`."""

from gvp_lib.motion.arc import Arc, approach, traverse_arc
from gvp_lib.motion.arm import STOPS, EyeInHandArm, Gripper, Hand, Motion, Outcome
from gvp_lib.motion.primitives import (
    advance,
    estimate_depth,
    pitch,
    planar_step,
    planar_vector,
    range_to,
    roll,
    toward_pixel,
    turn,
    yaw,
)
from gvp_lib.motion.sighting import Adjustment, Eye, View, align_with_major_axis, center_on_object

__all__ = [
    "Adjustment",
    "Arc",
    "STOPS",
    "Eye",
    "EyeInHandArm",
    "Gripper",
    "Hand",
    "Motion",
    "Outcome",
    "View",
    "advance",
    "align_with_major_axis",
    "approach",
    "center_on_object",
    "estimate_depth",
    "pitch",
    "planar_step",
    "planar_vector",
    "range_to",
    "roll",
    "toward_pixel",
    "traverse_arc",
    "turn",
    "yaw",
]
