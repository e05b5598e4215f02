"""Where an arm rests: joint angles from which its camera looks straight down at the middle of the workspace."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import UnreachableError
from gvp_lib.simulation.arms import ArmSpec
from gvp_lib.simulation.drive import ArmBodies, KinematicDrive
from gvp_lib.simulation.inverse_kinematics import InverseKinematics
from gvp_lib.simulation.scene import ARM_PREFIX, Stage, build_scene

__all__ = ["looking_down"]

_SEEDS = 8  # of searches, of which the best answer counts
_RESTARTS = 60
_WINDING = 0.03  # m of height that a radian of the most turned joint is worth


def looking_down(arm: ArmSpec, height: float = 0.35) -> ArmSpec:
    """The same arm with a home that was solved for, for an arm of which nobody has told you one.

    The camera stands over the middle of the workspace and looks straight down; what is far from the base is up in the
    image. Of the solutions found, clear of the table and of the arm itself, it is the one that carries the links
    high, elbow up, without turning a joint far from where the search begins.

    Parameters
    ----------
    arm
        Your arm; its present home is where the search begins, and may be all zeros.
    height
        Of the camera above the table, m.

    Raises
    ------
    UnreachableError
        No joint angles within the limits and free of collision were found.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from gvp_lib import ARMS
    >>> lost = replace(ARMS["ur5e"], home=(0.0,) * 6)
    >>> looking_down(lost).home != lost.home
    True
    """
    stage = Stage(arm.table_height, arm.floor_height, arm.workspace)
    middle = np.mean(arm.workspace, axis=1)
    away = middle / np.linalg.norm(middle) if np.linalg.norm(middle) > 1e-6 else np.array([1.0, 0.0])
    rotation = Rotation.from_matrix([[away[1], -away[0], 0], [-away[0], -away[1], 0], [0, 0, -1.0]])
    goal = RigidTransform.from_components([*middle, arm.table_height + height], rotation)

    model = build_scene(arm, [], [], stage).compile()
    data, kinematics = mujoco.MjData(model), InverseKinematics(arm.kinematic_model(), arm.camera, arm.joints)
    bodies = ArmBodies(model, ARM_PREFIX, arm.joints, np.ones(len(arm.joints)))
    drive = KinematicDrive(model, data, bodies, lambda: None)
    links = np.unique(model.geom_bodyid[bodies.geoms])

    touched: Counter[str] = Counter()

    def free(q: NDArray[np.float64]) -> bool:
        drive.put(q)
        touched.update(_touching(model, data, bodies))
        return not bodies.touching(data)

    found = []
    for seed in range(_SEEDS):
        q = kinematics.solve_any(goal, arm.home, seed, restarts=_RESTARTS, accept=free)
        if q is not None:
            drive.put(q)
            far = np.abs(q - np.asarray(arm.home)).max()
            found.append((float(data.xipos[links, 2].mean()) - _WINDING * far, q))
    if not found:
        raise _no_home(arm, height, goal, touched)
    return replace(arm, home=tuple(float(angle) for angle in max(found, key=lambda item: item[0])[1]))


def _no_home(arm: ArmSpec, height: float, goal: RigidTransform, touched: Counter[str]) -> UnreachableError:
    """Why no home was found: what got in the way most often, or that nothing within the limits reaches there."""
    where = f"{height} m above the middle of the workspace, {np.round(goal.translation, 3).tolist()} m (base frame)"
    if touched:
        return UnreachableError(
            f"arm {arm.name!r}: with the camera {where}, {touched.most_common(1)[0][0]}. If they overlap "
            "wherever the arm stands, make them smaller, or add <contact><exclude body1= body2=></contact>: MuJoCo "
            "lets a link overlap the one that carries it, but not a base that stands still"
        )
    return UnreachableError(
        f"arm {arm.name!r}: no joint angles within its limits put the camera {where}. Try another height, a "
        "workspace nearer to the base, or turn camera_mount: z looks out of the lens"
    )


def _touching(model: mujoco.MjModel, data: mujoco.MjData, bodies: ArmBodies) -> set[str]:
    """Which bodies that the joints move touch what, in words."""
    contacts = data.contact
    pairs = contacts.geom[bodies.geoms[contacts.geom].any(axis=1) & (contacts.dist < 0)] if data.ncon else []
    names = [
        sorted(model.body(model.geom_bodyid[geom]).name.removeprefix(ARM_PREFIX) for geom in pair) for pair in pairs
    ]
    return {f"{a!r} touches {b!r}" for a, b in names}
