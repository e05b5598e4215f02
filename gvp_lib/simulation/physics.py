"""The one set of solver settings, so that an object rests in an episode where it came to rest before it."""

from __future__ import annotations

import mujoco

__all__ = ["set_physics"]


def set_physics(scene: mujoco.MjSpec) -> None:
    """Solver settings under which a thousand grasps neither slip, sink nor explode."""
    option = scene.option
    option.timestep = 0.001  # s
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    option.impratio = 10
    option.noslip_iterations = 5
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_MULTICCD  # on by default in 4.0, it throws cylinders
