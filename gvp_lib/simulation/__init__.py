"""The simulated work cell. MuJoCo and mink live here; only this room knows the truth."""

import os
import sys

# MuJoCo reads this once, when it is first imported. EGL draws with and without a screen.
if sys.platform == "linux":
    os.environ.setdefault("MUJOCO_GL", "egl")
