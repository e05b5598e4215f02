"""Grasp viewpoint planning with one RGB camera in the hand (Smith, UC San Diego, 2020), in MuJoCo.

The names for everybody; their rooms, such as :mod:`gvp_lib.motion`, offer them and all others that are meant to stay.
Each is loaded when first used, so that ``import gvp_lib`` loads neither torch nor mujoco.
"""

from __future__ import annotations

import os
import sys

from gvp_lib.lazy import attach

# MuJoCo reads this once, when it is first imported, and every import of ours comes after this. EGL draws with and
# without a screen.
if sys.platform == "linux" and not os.environ.get("MUJOCO_GL", "").strip():
    os.environ["MUJOCO_GL"] = "egl"

__version__ = "0.2.0"

_ROOM = {
    "geometry": "Calibration HandEye calibrate calibrate_hand_eye look_at",
    "perception": "Segmenter Tracker",
    "motion": "Arc Hand Motion View align_with_major_axis approach center_on_object estimate_depth traverse_arc",
    "planning": "Action ClosingRule Grasp Optimum RangeThreshold SizedDepth Step Tilt ViewpointEstimator",
    "simulation": "CanonicalNormal FloatingCamera looking_down",
    "learning": "CollectionRecipe Variation",
}
"""Where the names are that version 0.1 offered here."""
_MOVED = {name: f"gvp_lib.{room}.{name}" for room, names in _ROOM.items() for name in names.split()} | {
    "GraspOutcome": "gvp_lib.motion.Outcome",
    "PlanOutcome": "gvp_lib.motion.Outcome",
    "StopReason": "gvp_lib.motion.Outcome",
}

__getattr__, __dir__, __all__ = attach(__name__, moved=_MOVED)
__all__ += ["__version__"]
