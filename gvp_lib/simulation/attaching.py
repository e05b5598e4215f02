"""Two MJCF models made one, without the settings of the first getting in the way of the second's."""

from __future__ import annotations

import mujoco

__all__ = ["adopt_settings"]

_LIMITS = ("memory", "njmax", "nconmax", "nstack")
_USER_DATA = tuple(f"nuser_{of}" for of in ("body", "jnt", "geom", "site", "cam", "tendon", "actuator", "sensor"))


def adopt_settings(child: mujoco.MjSpec, scene: mujoco.MjSpec) -> None:
    """Give a model the settings of the scene that it is about to be attached to.

    A model brings its own time step, gravity, solver, picture settings and memory. The scene's hold for all of
    it; of each that differs MuJoCo would say so on the screen. How the model's angles, inertias and file names
    are to be read (its ``compiler``) stays its own.
    """
    child.option, child.visual, child.stat = scene.option, scene.visual, scene.stat
    for name in _LIMITS:
        setattr(child, name, getattr(scene, name))
    for name in ("nuserdata", *_USER_DATA):  # room for what either has
        most = max(getattr(child, name), getattr(scene, name))
        setattr(child, name, most)
        setattr(scene, name, most)
