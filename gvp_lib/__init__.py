"""Grasp viewpoint planning with one RGB camera in the hand (Smith, UC San Diego, 2020), in MuJoCo.

The public names are loaded when first used, so that ``import gvp_lib`` loads neither torch nor mujoco.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.1.0"

_HOME = {
    "GvpError": "errors",
    "CameraIntrinsics": "geometry.camera",
    "VirtualSphere": "geometry.sphere",
    "look_at": "geometry.sphere",
    "EyeInHandArm": "motion.arm",
    "Gripper": "motion.arm",
    "Motion": "motion.arm",
    "StopReason": "motion.arm",
}

__all__ = [*_HOME, "__version__"]

if TYPE_CHECKING:
    from gvp_lib.errors import GvpError as GvpError
    from gvp_lib.geometry.camera import CameraIntrinsics as CameraIntrinsics
    from gvp_lib.geometry.sphere import VirtualSphere as VirtualSphere
    from gvp_lib.geometry.sphere import look_at as look_at
    from gvp_lib.motion.arm import EyeInHandArm as EyeInHandArm
    from gvp_lib.motion.arm import Gripper as Gripper
    from gvp_lib.motion.arm import Motion as Motion
    from gvp_lib.motion.arm import StopReason as StopReason


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
