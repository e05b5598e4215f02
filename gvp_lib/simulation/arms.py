"""The arms of the work cell: the UR5e and the Baxter's right arm."""

from __future__ import annotations

from importlib.resources import files

from gvp_lib.errors import UnknownNameError
from gvp_lib.simulation.arm_model import ArmSpec, GripperSpec

__all__ = ["ARMS", "ArmSpec", "GripperSpec", "arm_spec"]

_MODELS = files("gvp_lib.simulation") / "models"

# At home the camera looks straight down at the middle of the workspace from 0.35 m above the table; what is far
# from the robot is up in the image, what is on its right is on the right. The elbow is up, and every joint has
# at least a fifth of its range to either side.
ARMS: dict[str, ArmSpec] = {
    "ur5e": ArmSpec(
        name="ur5e",
        mjcf=_MODELS / "ur5e.xml",
        camera="hand_camera",
        joints=("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"),
        home=(0.2699, -1.5829, -1.8374, -1.2922, 1.5708, 0.2699),
        table_height=0.0,
        floor_height=-0.75,
        workspace=((0.45, 0.55), (-0.1, 0.1)),
        joint_speed=3.1416,
    ),
    "baxter": ArmSpec(
        name="baxter",
        mjcf=_MODELS / "baxter.xml",
        camera="hand_camera",
        joints=("right_s0", "right_s1", "right_e0", "right_e1", "right_w0", "right_w1", "right_w2"),
        home=(0.0739, -0.9087, 1.0153, 1.8746, -0.6728, 0.9940, 0.6025),
        table_height=-0.20,
        floor_height=-0.93,
        workspace=((0.55, 0.65), (-0.4, -0.1)),
        gripper=GripperSpec(
            actuator="gripper",
            finger_joints=("finger_a", "finger_b"),
            range_site="ir_sensor",
            grasp_site="grasp",
            max_width=0.072,
        ),
        joint_speed=(2.0, 2.0, 2.0, 2.0, 4.0, 4.0, 4.0),
    ),
}


def arm_spec(arm: str | ArmSpec) -> ArmSpec:
    """The spec of a known arm by its name; a spec is returned as it is.

    Raises
    ------
    UnknownNameError
        Where no arm has that name.
    """
    if isinstance(arm, ArmSpec):
        return arm
    if arm not in ARMS:
        raise UnknownNameError("arm", arm, ARMS)
    return ARMS[arm]
