"""The simulated work cell. MuJoCo and mink live here; only this room knows the truth."""

from gvp_lib.errors import RenderingError

try:
    import mujoco  # noqa: F401 - here first, for its own error does not say what is missing
except ImportError:  # MuJoCo itself is missing
    raise
except Exception as error:  # its bindings of OpenGL fail in many ways
    raise RenderingError.from_error(error) from error

from gvp_lib.simulation.arms import ARMS, ArmSpec, GripperSpec
from gvp_lib.simulation.base import HolonomicBase
from gvp_lib.simulation.camera import distorted
from gvp_lib.simulation.kinematics import InverseKinematics, looking_down
from gvp_lib.simulation.moving import ContactRecord, Rocking, Sliding, Turning, moving_target, record_contacts, shake
from gvp_lib.simulation.objects import OBJECTS, BoundingBox, ObjectSpec, box_normals
from gvp_lib.simulation.placements import PLACEMENTS
from gvp_lib.simulation.robot import FloatingCamera, SimulatedArm, SimulatedGripper
from gvp_lib.simulation.sensors import EpisodeNoise, Noise, RangeSensor
from gvp_lib.simulation.truth import AcceptedNormal, CanonicalNormal, Truth
from gvp_lib.simulation.workcell import CellCache, WorkCell

__all__ = [
    "ARMS",
    "OBJECTS",
    "PLACEMENTS",
    "AcceptedNormal",
    "ArmSpec",
    "BoundingBox",
    "CanonicalNormal",
    "CellCache",
    "ContactRecord",
    "EpisodeNoise",
    "FloatingCamera",
    "GripperSpec",
    "HolonomicBase",
    "InverseKinematics",
    "Noise",
    "ObjectSpec",
    "RangeSensor",
    "Rocking",
    "SimulatedArm",
    "SimulatedGripper",
    "Sliding",
    "Truth",
    "Turning",
    "WorkCell",
    "box_normals",
    "distorted",
    "looking_down",
    "moving_target",
    "record_contacts",
    "shake",
]
