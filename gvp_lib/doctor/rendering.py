"""Can MuJoCo draw here without a screen?"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from ctypes.util import find_library

from gvp_lib.doctor.check import Check

__all__ = ["check_rendering"]

_PROGRAM = [sys.executable, "-m", "gvp_lib.doctor.drawing"]


def check_rendering(timeout: float = 60.0) -> Check:
    """MuJoCo draws a frame, the frame shows what it should, and how long it took.

    Parameters
    ----------
    timeout
        Give up after so many seconds.
    """
    environment = dict(os.environ)
    if _is_headless():
        environment.setdefault("MUJOCO_GL", "egl")
    backend = environment.get("MUJOCO_GL") or "MuJoCo's default"
    try:
        result = subprocess.run(_PROGRAM, capture_output=True, text=True, timeout=timeout, env=environment)
    except subprocess.TimeoutExpired:
        return _failed(f"no frame after {timeout:g} s ({backend})")
    if result.returncode != 0:
        return _failed(f"no frame ({backend}): {_reason(result)}")
    drawn = json.loads(result.stdout.strip().splitlines()[-1])
    if not drawn["red"]:
        return _failed(f"a red box was drawn and the picture is not red ({backend}, {drawn['driver']})")
    times = f"640x480 in {1e3 * drawn['frame']:.1f} ms, the first in {1e3 * drawn['first']:.0f} ms"
    return Check("rendering", True, f"{times} ({backend}, {drawn['driver']})")


def _reason(result: subprocess.CompletedProcess[str]) -> str:
    """Why the program failed. Without libEGL the bindings fail in a way that does not say so."""
    if sys.platform == "linux" and find_library("EGL") is None:
        return "libEGL is not installed"
    return (result.stderr.strip().splitlines() or [f"the process ended with {result.returncode}"])[-1]


def _is_headless() -> bool:
    """Whether this is a Linux without a screen, where MuJoCo must be told to draw by EGL."""
    return sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _failed(detail: str) -> Check:
    if sys.platform == "darwin":
        mend = "unset MUJOCO_GL and run in a session logged in on the Mac's own screen"
    elif shutil.which("apt-get"):
        mend = "sudo apt-get install libegl1 libgl1 libgl1-mesa-dri, then set MUJOCO_GL=egl"
    elif shutil.which("dnf"):
        mend = "sudo dnf install mesa-libEGL mesa-libGL mesa-dri-drivers, then set MUJOCO_GL=egl"
    else:
        mend = "install Mesa's EGL and DRI drivers (Arch, Alpine: mesa), then set MUJOCO_GL=egl"
    return Check("rendering", False, detail, mend)
