"""Specs of arms, and the models behind them: ours against published tables and against themselves, and anybody's."""

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError, ModelError
from gvp_lib.simulation.arms import ARMS, ArmSpec, GripperSpec
from gvp_lib.simulation.kinematics import InverseKinematics
from gvp_lib.simulation.workcell import WorkCell

# Universal Robots, "DH parameters for calculations of kinematics and dynamics", UR5e: (a, d, alpha), standard DH, and
# the offset of the angle.
UR5E = [
    (0.0, 0.1625, np.pi / 2, 0.0),
    (-0.425, 0.0, 0.0, 0.0),
    (-0.3922, 0.0, 0.0, 0.0),
    (0.0, 0.1333, np.pi / 2, 0.0),
    (0.0, 0.0997, -np.pi / 2, 0.0),
    (0.0, 0.0996, 0.0, 0.0),
]

# R. L. Williams II, "Baxter humanoid robot kinematics", 2017: lengths of the seven-joint arm, in its zero posture
# straight ahead. The last d runs to the hand's frame (0.11355 m beyond the wrist) instead of to the paper's gripper.
BAXTER = [
    (0.069, 0.27035, -np.pi / 2, 0.0),
    (0.0, 0.0, np.pi / 2, np.pi / 2),
    (0.069, 0.36435, -np.pi / 2, 0.0),
    (0.0, 0.0, np.pi / 2, 0.0),
    (0.010, 0.37429, -np.pi / 2, 0.0),
    (0.0, 0.0, np.pi / 2, 0.0),
    (0.0, 0.229525, 0.0, 0.0),
]
# Rethink Robotics, baxter_description: torso to the axis of right_s0.
TORSO_FROM_SHOULDER = RigidTransform.from_components(
    [0.064027, -0.259027, 0.129626], Rotation.from_euler("z", -np.pi / 4)
)

# Somebody else's arm: degrees, default joint names, a motor, a keyframe, a sensor, its own floor and lamp.
FOREIGN = """
<mujoco model="somebody's">
  <compiler angle="degree"/>
  <worldbody>
    <light pos="0 0 3"/>
    <geom name="floor" type="plane" size="1 1 0.1"/>
    <geom name="stand" type="box" size="0.1 0.1 0.05" pos="0 0 0.05"/>
    <body name="a" pos="0 0 0.1">
      <joint name="turn" axis="0 0 1" range="-170 170"/>
      <geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.03"/>
      <body name="b" pos="0 0 0.3">
        <joint name="bend" axis="0 1 0" range="-120 120"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03"/>
        <body name="c" pos="0.3 0 0">
          <joint name="tip" axis="0 1 0" range="-150 150"/>
          <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.02"/>
          <site name="tool" pos="0.1 0 0" euler="0 90 0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="m" joint="bend"/></actuator>
  <sensor><jointpos joint="bend"/></sensor>
  <size nkey="2"/>
  <keyframe><key name="up" qpos="0 0 0"/></keyframe>
</mujoco>
"""
BALL_JOINT = FOREIGN.replace('"tip" axis="0 1 0" range="-150 150"', '"tip" type="ball"')
SEEING = FOREIGN.replace("<site", '<camera name="eye"/><site')
ALONG_TOOL = RigidTransform.identity()
PLAIN = SEEING.partition("<actuator>")[0] + "</mujoco>"  # nothing in it calls anything by its name
NAMELESS = {
    "mjcf": re.sub(' name="[^"]*"', "", PLAIN),
    "joints": ("unnamed_joint_0", "unnamed_joint_1", "unnamed_joint_2"),
    "camera_mount": ("unnamed_site_0", ALONG_TOOL),
}

ours = pytest.mark.parametrize("spec", ARMS.values(), ids=ARMS)


def foreign(**changes) -> ArmSpec:
    joints, home = ("turn", "bend", "tip"), (0.0, 0.5, 0.5)
    return replace(ArmSpec("somebody's", FOREIGN, "eye", joints, home, camera_mount=("tool", ALONG_TOOL)), **changes)


def loaded(spec: ArmSpec):
    """The model of an arm, its data at home, the places of its joints in ``qpos``, and their ranges, (2, n)."""
    model = spec.load().compile()
    data = mujoco.MjData(model)
    joints = [model.joint(name) for name in spec.joints]
    places = np.array([joint.qposadr[0] for joint in joints])
    data.qpos[places] = spec.home
    mujoco.mj_forward(model, data)
    return model, data, places, np.array([joint.range for joint in joints]).T


def contacts(model, data, places, postures) -> list[set[frozenset[str]]]:
    """Pairs of bodies that touch in each posture."""
    found = []
    for data.qpos[places] in postures:
        mujoco.mj_fwdPosition(model, data)
        pairs = model.geom_bodyid[data.contact.geom]
        found.append({frozenset(model.body(body).name for body in pair) for pair in pairs})
    return found


@pytest.mark.parametrize(
    ("arm", "base", "table", "error_mm", "error_deg"),
    [
        ("ur5e", RigidTransform.identity(), UR5E, 0.01, 0.001),
        ("baxter", TORSO_FROM_SHOULDER, BAXTER, 0.1, 0.01),
    ],
)
def test_the_flange_is_where_published_tables_say(arm, base, table, error_mm, error_deg):
    model, data, places, limits = loaded(ARMS[arm])
    postures, expected = np.random.default_rng(0).uniform(*limits, (1000, len(places))), base
    for angles, (a, d, alpha, offset) in zip(postures.T, table, strict=True):
        expected *= RigidTransform.from_rotation(Rotation.from_euler("z", (angles + offset)[:, None]))
        expected *= RigidTransform.from_components([a, 0, d], Rotation.from_euler("x", alpha))
    flanges = []
    for data.qpos[places] in postures:
        mujoco.mj_kinematics(model, data)
        flange = data.site("flange")
        turn = Rotation.from_matrix(flange.xmat.reshape(3, 3))
        flanges.append(RigidTransform.from_components(flange.xpos, turn))
    off = expected.inv() * RigidTransform.concatenate(flanges)
    assert np.linalg.norm(off.translation, axis=1).max() < error_mm / 1000
    assert np.degrees(off.rotation.magnitude()).max() < error_deg


@ours
def test_at_home_the_camera_looks_straight_down_at_the_middle_of_the_workspace_from_350_mm(spec, kinematics_of):
    pose = kinematics_of(spec).forward(spec.home)
    assert pose.translation == pytest.approx([*np.mean(spec.workspace, axis=1), spec.table_height + 0.35], abs=1e-3)
    _, y, z = pose.rotation.as_matrix().T
    assert z == pytest.approx([0, 0, -1], abs=1e-3)
    assert y == pytest.approx([-1, 0, 0], abs=1e-3)  # what is far from the robot is up in the image


@ours
def test_nothing_touches_around_home_nor_neighbors_anywhere_but_a_folded_arm_touches_itself(spec):
    model, data, places, limits = loaded(spec)
    rng, n = np.random.default_rng(0), len(places)
    around_home = [spec.home, *(spec.home + rng.uniform(-0.3, 0.3, (200, n)))]
    assert not any(contacts(model, data, places, around_home))
    anywhere = contacts(model, data, places, rng.uniform(*limits, (300, n)))
    bodies = [model.body(model.jnt_bodyid[model.joint(joint).id]).name for joint in spec.joints]
    assert not set().union(*anywhere) & {frozenset(pair) for pair in pairwise(bodies)}
    assert sum(map(bool, anywhere)) > 15  # or there would be no collision geometry


def test_open_fingers_leave_a_128_mm_object_at_250_mm_in_view_even_100_px_off_the_center():
    model, data, *_ = loaded(ARMS["baxter"])
    names = [model.body(body).name for body in model.geom_bodyid]
    hand = [geom for geom, name in enumerate(names) if name.startswith(("finger", "gripper"))]
    with mujoco.Renderer(model, 480, 640) as renderer:
        renderer.enable_segmentation_rendering()
        renderer.update_scene(data, "hand_camera")
        _, columns = np.nonzero(np.isin(renderer.render()[..., 0], hand))
    focal = 240 / np.tan(np.radians(24.4))
    assert np.abs(columns - 319.5).min() > 100 + 0.064 / 0.25 * focal


ON_BODY = "c", RigidTransform.from_components([0.1, 0, 0], Rotation.from_euler("y", 90, degrees=True))


@pytest.mark.parametrize("mount", [("tool", ALONG_TOOL), ON_BODY], ids=["on a site", "on a body"])
@pytest.mark.parametrize("kind", [None, Path, str])
def test_a_model_that_is_not_ours_loads_with_a_camera_on_its_tool_and_the_kinematics_work(kind, mount, tmp_path):
    (tmp_path / "arm.xml").write_text(FOREIGN)
    spec = foreign(mjcf=kind(tmp_path / "arm.xml") if kind else FOREIGN, camera_mount=mount)
    model = spec.load().compile()
    assert np.radians(model.cam_fovy[model.camera("eye").id]) == pytest.approx(np.radians(48.8))
    # Keyframes, lamps and floors belong to the scene that it came from.
    assert model.nkey == model.nlight == 0
    assert [model.geom(i).name for i in range(model.ngeom) if model.geom(i).name] == ["stand"]
    kinematics = InverseKinematics(spec)
    pose = kinematics.forward([0.0, 0.0, 0.0])
    # The tool's z axis is the arm's x axis, straight out at zero angles; the optical axis is the tool's.
    assert pose.translation == pytest.approx([0.4, 0.0, 0.4], abs=1e-9)
    assert pose.rotation.as_matrix()[:, 2] == pytest.approx([1, 0, 0], abs=1e-9)
    target = kinematics.forward([0.2, 0.6, 0.4])
    assert kinematics.solve(target, spec.home) == pytest.approx([0.2, 0.6, 0.4], abs=2e-3)
    assert foreign(camera_mount=mount, fovy=1.0).load().compile().cam_fovy[0] == pytest.approx(np.degrees(1.0))


@pytest.mark.parametrize(
    ("kind", "changes"),
    [
        ("body", {}),
        ("joint", {"joints": NAMELESS["joints"]}),
        ("site", {"camera_mount": NAMELESS["camera_mount"]}),
        ("camera", {"camera": "unnamed_camera_0", "camera_mount": None}),
    ],
)
def test_what_a_model_leaves_without_a_name_works_as_if_it_had_one(kind, changes):
    named = foreign(mjcf=PLAIN, **({"camera_mount": None} if kind == "camera" else {"camera": "lens"}))
    seen = []
    for spec in (named, replace(named, mjcf=re.sub(f'<{kind} name="[^"]*"', f"<{kind}", PLAIN), **changes)):
        with WorkCell(spec, "cuboid_1x1", seed=1) as cell:
            target = InverseKinematics(spec).forward([0.2, 0.6, 0.4])
            solved = InverseKinematics(spec).solve(target, spec.home)
            seen.append([solved, cell.truth.world_from_camera.as_matrix(), cell.model.camera("overview").pos])
    for expected, found in zip(*seen, strict=True):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("unit", ["", "pixel"])
def test_a_stated_field_of_view_replaces_the_lens_that_the_model_gives_its_camera(unit):
    size = "320 240" if unit else ".003 .003"
    lens = f'resolution="640 480" sensorsize=".0064 .0048" focal{unit}="{size}" principal{unit}="{size}"'
    model = FOREIGN.replace('<site name="tool"', f'<camera name="eye" {lens}/><site name="tool"')
    stated = foreign(mjcf=model, camera_mount=None, fovy=1.0).load().compile()
    assert stated.cam_fovy[0] == pytest.approx(np.degrees(1.0))
    assert not stated.cam_sensorsize[0].any()
    assert foreign(mjcf=model, camera_mount=None).load().compile().cam_sensorsize[0].all()


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"camera_mount": None}, "no camera 'eye'. It has: none; camera_mount can add one"),
        ({"camera_mount": ("hand", ALONG_TOOL)}, "no body or site 'hand'. It has: a, b, c, tool, world"),
        ({"mjcf": SEEING}, "already has a camera 'eye'; drop camera_mount to use it"),
        ({"joints": ("turn", "knee", "tip")}, "no joint 'knee'. It has: bend, tip, turn"),
        ({"mjcf": BALL_JOINT}, "joint 'tip' neither turns nor slides"),
        ({"home": (0.0, 2.2, 0.0)}, "home puts joint 'bend' at 2.2000, outside its range -2.0944 to 2.0944"),
        ({"leave_out": ("puck",)}, "no body 'puck'. It has: a, b, c, world"),
        (
            NAMELESS | {"joints": ("", "bend", "tip")},
            "no joint ''. It has: unnamed_joint_0, unnamed_joint_1, ",
        ),
        (
            NAMELESS | {"camera_mount": ("", ALONG_TOOL)},
            "no body or site ''. It has: unnamed_body_1, unnamed_body_2, ",
        ),
        (NAMELESS | {"camera_mount": None}, "no camera 'eye'. It has: unnamed_camera_0; camera_mount can add one"),
        ({"mjcf": FOREIGN.replace('joint="bend"/></actuator>', 'joint="knee"/></actuator>')}, "does not compile"),
        ({"gripper": GripperSpec("grip", ("f",), "beam", "tool", 0.07)}, "no site 'beam'. It has: tool"),
        ({"gripper": GripperSpec("grip", ("f",), "tool", "tool", 0.07)}, "no actuator 'grip'. It has: m"),
        ({"gripper": GripperSpec("m", ("f",), "tool", "tool", 0.07)}, "no joint 'f'. It has: bend, tip, turn"),
    ],
)
def test_a_model_that_lacks_something_is_refused_with_what_it_has(changes, text):
    with pytest.raises(ModelError) as error:
        foreign(**changes).load()
    assert text in str(error.value)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: foreign(home=(0.0, 0.0)), "home has 2 angles for 3 joints"),
        (lambda: foreign(joint_speed=(1.0, 2.0)), "joint_speed has 2 values for 3 joints"),
        (lambda: foreign(joints=(), home=()), "name the joints that move"),
        (lambda: foreign(home=(0.0, np.nan, 0.0)), "home is finite, in rad; got"),
        (lambda: foreign(camera=""), "camera names one, of the model or to be; got ''"),
        (lambda: foreign(fovy=48.8), "fovy is between 0 and pi rad"),
        (lambda: GripperSpec("m", ("f",), "a", "b", 0.0), "max_width is positive, in meters; got 0"),
        (lambda: GripperSpec("m", (), "a", "b", 0.07), "finger_joints is empty; name its sliding joints"),
        (lambda: replace(ARMS["ur5e"], joint_speed=-1.0), "joint_speed is positive, in rad/s; got -1.0"),
    ],
)
def test_a_spec_that_contradicts_itself_is_refused(make, text):
    with pytest.raises(InvalidParameterError, match=text):
        make()
