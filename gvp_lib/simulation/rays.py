"""A scene as rays see it: the object to grasp, what stands around it, and the open hand. For judges, who may know."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.simulation.camera import camera_pose
from gvp_lib.simulation.scene import ARM_PREFIX
from gvp_lib.simulation.workcell import WorkCell

__all__ = ["RayScene"]

_GROUPS = {"target": 0, "around": 1}
_IGNORED = 5
_BACK = 0.25  # m behind the camera, from where rays ahead begin, since fingers may stand in the scene
_OPAQUE = 1.0


class RayScene:
    """Copy of a cell's scene at the moment it is made, and its hand with the fingers open.

    Attributes
    ----------
    world_from_camera
        Pose of the camera.
    center, mass_center
        Origin and center of mass of the target, world frame, m, shape (3,).
    middles, halves
        Middles and half extents of the boxes about the fingers' geoms in the camera's frame, m, shape (n, 3).
    pad
        Index of the box of a pad, which reaches farthest.
    friction
        Friction of the pads.
    """

    def __init__(self, cell: WorkCell) -> None:
        wide = cell.gripper.stroke[1]  # a ModelError where there is no hand
        spec, model = cell.arm_spec, copy.copy(cell.model)
        assert spec is not None
        assert spec.gripper is not None
        data = mujoco.MjData(model)
        for name in ("qpos", "mocap_pos", "mocap_quat"):
            getattr(data, name)[:] = getattr(cell.data, name)
        for joint in spec.gripper.finger_joints:
            data.joint(ARM_PREFIX + joint).qpos[:] = wide / len(spec.gripper.finger_joints)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_camlight(model, data)
        self._model, self._data, body = model, data, cell.target_body
        self.world_from_camera = camera_pose(data, model.camera(ARM_PREFIX + spec.camera).id)
        self.center, self.mass_center = data.xpos[body].copy(), data.subtree_com[body].copy()

        touches = (model.geom_contype | model.geom_conaffinity) != 0
        fingers = np.array([geom for geom in sorted(cell.finger_geoms) if touches[geom]])
        turns = self.world_from_camera.rotation.as_matrix().T @ data.geom_xmat[fingers].reshape(-1, 3, 3)
        boxes = model.geom_aabb[fingers]
        self.middles = self.world_from_camera.inv().apply(data.geom_xpos[fingers])
        self.middles += np.einsum("nij,nj->ni", turns, boxes[:, :3])
        self.halves = np.einsum("nij,nj->ni", np.abs(turns), boxes[:, 3:])
        self.pad = int(np.argmax((self.middles + self.halves)[:, 2]))
        self.friction = float(model.geom_friction[fingers[self.pad], 0])

        of_arm = np.array([model.body(each).name.startswith(ARM_PREFIX) for each in model.geom_bodyid])
        of_target = model.body_rootid[model.geom_bodyid] == body
        model.geom_group[:] = np.where(of_target, _GROUPS["target"], _GROUPS["around"])
        model.geom_group[of_arm | ~touches] = _IGNORED
        model.geom_matid[:], model.geom_rgba[:, 3] = -1, _OPAQUE  # rays pass through what is transparent

    def hits(
        self,
        view: RigidTransform,
        points: NDArray[np.float64],
        direction: Sequence[float],
        what: Literal["target", "around"] = "target",
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Distances to what rays hit, (n,), m, ``inf`` where they hit nothing, and the normals there, (n, 3).

        Points (n, 3), direction and normals are in the frame of a camera at ``view``, ``world_from_camera``.
        """
        mask = np.zeros(mujoco.mjNGROUP, np.uint8)
        mask[_GROUPS[what]] = 1
        turn, starts = view.rotation.as_matrix(), view.apply(points)
        along, geom = turn @ np.array(direction, float), np.zeros(1, np.int32)
        distances, normals = np.empty(len(points)), np.zeros((len(points), 3))
        for i, start in enumerate(starts):
            distances[i] = mujoco.mj_ray(self._model, self._data, start, along, mask, True, -1, geom, normals[i])
        return np.where(distances < 0, np.inf, distances), normals @ turn

    def depths(
        self, view: RigidTransform, x: NDArray[np.float64], y: NDArray[np.float64], what: Literal["target", "around"]
    ) -> NDArray[np.float64]:
        """How far ahead of a camera something is at each (x, y), m, in the shape of x; ``inf`` where nothing is."""
        points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -_BACK)])
        return self.hits(view, points, (0, 0, 1), what)[0].reshape(x.shape) - _BACK
