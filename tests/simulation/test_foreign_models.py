"""An arm and objects that are not ours, through the door of ours: Gymnasium's Pusher, and one of meshcat's meshes.

Nothing here is copied: the models are read from where the packages that carry them are installed.
"""

import warnings
from dataclasses import replace
from importlib.metadata import files
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import ModelError
from gvp_lib.motion.arm import EyeInHandArm
from gvp_lib.perception.blobs import Blob
from gvp_lib.perception.segmentation import Saliency
from gvp_lib.simulation.arms import ArmSpec
from gvp_lib.simulation.objects import ObjectSpec
from gvp_lib.simulation.workcell import WorkCell


def carried_by(package: str, name: str) -> Path:
    """A file of an installed package, found without importing the package."""
    return Path(next(file for file in files(package) if file.as_posix().endswith(name)).locate()).resolve()


PUSHER = carried_by("gymnasium", "mujoco/assets/pusher_v5.xml")
WEDGE = carried_by("meshcat", "tests/data/mesh_0_convex_piece_0.obj")

# Beneath the hand, which stands a little upward, so that the camera looks straight down where the arm moves best.
LOOKING_DOWN = Rotation.from_matrix(np.column_stack([[0, -1, 0], [-1, 0, 0], [0, 0, -1]]))
MOUNT = RigidTransform.from_components([0.05, 0, -0.03], Rotation.from_euler("y", 0.35) * LOOKING_DOWN)
JOINTS = ("shoulder_pan", "shoulder_lift", "upper_arm_roll", "elbow_flex", "forearm_roll", "wrist_flex", "wrist_roll")

# Seven hinges, motors, no camera, no gravity, a time step of its own, a puck and a goal on slides.
ARM = ArmSpec(
    name="pusher",
    mjcf=PUSHER,
    camera="eye",
    camera_mount=("r_wrist_roll_link", MOUNT),
    joints=tuple(f"r_{name}_joint" for name in JOINTS),
    home=(0.0, 0.9, 0.0, -1.0, 0.0, -0.25, 0.0),
    table_height=-0.64,
    floor_height=-1.2,
    workspace=((0.70, 0.75), (-0.65, -0.55)),
    leave_out=("object", "goal"),
)

# A mesh in a file that its MJCF names relatively, in degrees, without naming a body.
BODY = """
  <mujoco>
    <compiler angle="degree" meshdir="shapes"/> <option timestep="0.5" gravity="0 0 -1"/> <size nuserdata="4"/>
    <asset><mesh name="m" file="wedge.obj" scale=".4 .4 .4"/></asset>
    <worldbody><body><geom type="mesh" mesh="m" euler="90 0 0" rgba=".1 .6 .2 1"/></body></worldbody>
  </mujoco>"""


def wedge(folder: Path) -> ObjectSpec:
    (folder / "shapes").mkdir(exist_ok=True)
    (folder / "shapes" / "wedge.obj").write_bytes(WEDGE.read_bytes())
    document = folder / "wedge.xml"
    document.write_text(BODY)
    return ObjectSpec("wedge", document, Saliency())


def above(cell: WorkCell, tilt_deg: float = 0.0) -> RigidTransform:
    """The home view, carried over the sphere about the object."""
    center = cell.truth.world_from_object.apply(cell.target_spec.bounding_box().center)
    tilt = Rotation.from_rotvec(np.radians(tilt_deg) * np.array([-0.5, -0.866, 0]))
    return RigidTransform.from_components(center + tilt.apply([0, 0, 0.3]), tilt * LOOKING_DOWN)


def test_somebody_elses_arm_and_object_stand_in_our_cell_without_a_word_on_the_screen(tmp_path, capfd):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cell = WorkCell(ARM, wedge(tmp_path), others=["cuboid_1x1"], seed=1)
    assert capfd.readouterr() == ("", "")
    assert isinstance(cell.arm, EyeInHandArm)
    # The scene's own settings hold, whatever the two models brought.
    assert cell.model.opt.timestep == pytest.approx(0.001)
    assert cell.model.opt.gravity.tolist() == [0, 0, -9.81]
    assert cell.model.nuserdata == 4
    names = {cell.model.body(i).name for i in range(cell.model.nbody)}
    assert "arm/tips_arm" in names
    assert not names & {"arm/object", "arm/goal"}  # left out


def test_its_camera_stands_moves_and_rolls_about_its_own_axis_though_that_is_not_the_last_joints(tmp_path):
    with WorkCell(ARM, wedge(tmp_path), seed=1) as cell:
        arm, goal = cell.arm, above(cell, 15)
        step, turn = RigidTransform.from_translation([0.02, 0.01, 0.03]), Rotation.from_rotvec([0, 0, 0.2])
        cell.place_camera(goal)
        for move, by in (
            (lambda: True, RigidTransform.identity()),
            (lambda: arm.move_camera(step), step),
            (lambda: arm.rotate_wrist(0.2), RigidTransform.from_rotation(turn)),
        ):
            assert move()
            goal *= by
            off = goal.inv() * cell.truth.world_from_camera
            assert np.linalg.norm(off.translation) < 2e-4
            assert off.rotation.magnitude() < np.radians(0.1)


@pytest.mark.full
def test_only_what_the_joints_carry_can_collide():
    # The puck of the model stands half in the table, and no arm is to blame.
    spec = replace(
        ARM, leave_out=("goal",), table_height=-0.30, floor_height=-0.8, workspace=((0.42, 0.48), (-0.1, 0.0))
    )
    with WorkCell(spec, "cuboid_1x1", seed=1) as cell:
        assert cell.data.ncon
        assert not len(cell._drive.contacts())
        assert cell.arm.move_joints(cell.arm.joints + 0.02)


def test_motors_are_refused_in_the_dynamic_mode_with_the_mend():
    with pytest.raises(ModelError, match=r"joint 'r_shoulder_pan_joint' has no position servo.*dynamic=False"):
        WorkCell(ARM, dynamic=True)


@pytest.mark.full
@pytest.mark.parametrize("placement", ["flat", "tilted"])
def test_an_object_that_is_only_a_mesh_comes_to_rest_and_is_seen(placement, tmp_path):
    with WorkCell("floating", wedge(tmp_path), placement, seed=2) as cell:
        tilt = np.degrees(cell.truth.normal.angle([0, 0, 1.0]))
        assert 15 <= tilt <= 30 if placement == "tilted" else tilt < 1
        cell.place_camera(above(cell))
        blob = Blob.from_mask(cell.segmenter(cell.arm.capture()))
        assert np.linalg.norm(blob.centroid - cell.arm.intrinsics.principal_point) < 40


def test_a_mesh_that_is_not_there_is_refused_by_its_name():
    with pytest.raises(ModelError, match=r"'wedge'.*lost\.obj"):
        WorkCell("floating", ObjectSpec("wedge", BODY.replace("wedge.obj", "lost.obj"), Saliency()))
