"""What only the simulator knows. For judges, labels and figures; a planner that reads it is a defect."""

from __future__ import annotations

import mujoco
from scipy.spatial.transform import RigidTransform

from gvp_lib.simulation.frames import camera_pose, pose
from gvp_lib.simulation.normals import AcceptedNormal
from gvp_lib.simulation.object_model import ObjectSpec

__all__ = ["Truth"]


class Truth:
    """The true poses of the present episode, as they are when asked for."""

    def __init__(self, spec: ObjectSpec) -> None:
        self._spec = spec

    def begin_episode(self, data: mujoco.MjData, target_body: int, camera: int) -> None:
        """Judge from now on by the object as it stands in ``data``; for the cell, when it sets an episode up."""
        self._data, self._body, self._camera = data, target_body, camera
        self._as_placed = self.world_from_object
        self._accepted = self._spec.accepted_normal(self._as_placed)

    @property
    def world_from_object(self) -> RigidTransform:
        """Where the object is now."""
        return pose(self._data.xpos[self._body], self._data.xmat[self._body])

    @property
    def world_from_camera(self) -> RigidTransform:
        """Where the camera is now (optical frame), encoder errors included."""
        return camera_pose(self._data, self._camera)

    @property
    def normal(self) -> AcceptedNormal:
        """The canonical normal that was nearest the vertical as the object was placed, carried along with the
        object should it move."""
        return self._accepted.rotated((self.world_from_object * self._as_placed.inv()).rotation)

    def viewpoint_error(self) -> float:
        """Angle between the reversed optical axis and the object's accepted normal, rad (Eq. 2.10; errata 16).

        For a lying can, whose accepted normals are the circle across its axis, the angle to that circle.
        """
        return self.normal.view_angle(self.world_from_camera)

    def roll_error(self) -> float:
        """The roll that the camera has yet to make, rad, until its y axis aligns with the object's major axis,
        modulo the object's symmetry; 0 where any roll is right."""
        return self.normal.roll_error(self.world_from_camera)
