"""What only the simulator knows. For judges, labels and figures; a planner that reads it is a defect."""

from __future__ import annotations

from collections.abc import Callable

from scipy.spatial.transform import RigidTransform

from gvp_lib.simulation.normals import AcceptedNormal
from gvp_lib.simulation.object_model import ObjectSpec

__all__ = ["Truth"]


class Truth:
    """The true poses of an episode, as they are when asked for."""

    def __init__(
        self, spec: ObjectSpec, object_pose: Callable[[], RigidTransform], camera_pose: Callable[[], RigidTransform]
    ) -> None:
        self._object_pose, self._camera_pose = object_pose, camera_pose
        self._as_placed = object_pose()
        self._accepted = spec.accepted_normal(self._as_placed)

    @property
    def world_from_object(self) -> RigidTransform:
        """Where the object is now."""
        return self._object_pose()

    @property
    def world_from_camera(self) -> RigidTransform:
        """Where the camera is now (optical frame), encoder errors included."""
        return self._camera_pose()

    @property
    def normal(self) -> AcceptedNormal:
        """The canonical normal that was nearest the vertical as the object was placed, carried along with the
        object should it move."""
        return self._accepted.rotated((self.world_from_object * self._as_placed.inv()).rotation)

    def viewpoint_error(self) -> float:
        """Angle between the reversed optical axis and the object's accepted normal, rad (Eq. 2.10; errata 16).

        For a lying can, whose accepted normals are the circle across its axis, the angle to that circle.
        """
        return self.normal.angle(-self.world_from_camera.rotation.as_matrix()[:, 2])

    def roll_error(self) -> float:
        """Angle from the object's major axis to the camera's y axis about the line of sight, rad, modulo the
        object's symmetry; 0 where any roll is right."""
        return self.normal.roll_error(self.world_from_camera)
