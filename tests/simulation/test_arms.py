from dataclasses import replace
from itertools import pairwise

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError, ModelError, UnknownNameError
from gvp_lib.simulation.arms import ARMS, ArmSpec, GripperSpec, arm_spec
from gvp_lib.simulation.kinematics import InverseKinematics

NAMES = ["ur5e", "baxter"]

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
  <keyframe><key name="up" qpos="0 0 0"/></keyframe>
</mujoco>
"""
LOOKING_ALONG_TOOL = RigidTransform.identity()


def foreign(**changes) -> ArmSpec:
    spec = ArmSpec(
        name="somebody's",
        mjcf=FOREIGN,
        camera="eye",
        joints=("turn", "bend", "tip"),
        home=(0.0, 0.5, 0.5),
        camera_mount=("tool", LOOKING_ALONG_TOOL),
    )
    return replace(spec, **changes)


def at_home(spec: ArmSpec) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = spec.load().compile()
    data = mujoco.MjData(model)
    for name, angle in zip(spec.joints, spec.home, strict=True):
        data.joint(name).qpos = angle
    mujoco.mj_forward(model, data)
    return model, data


def contacts(model, data) -> set[frozenset[str]]:
    return {
        frozenset(model.body(model.geom_bodyid[geom]).name for geom in (contact.geom1, contact.geom2))
        for contact in data.contact
    }


@pytest.mark.parametrize("name", NAMES)
def test_at_home_the_camera_looks_straight_down_at_the_middle_of_the_workspace_from_350_mm(name):
    spec = ARMS[name]
    pose = InverseKinematics(spec).forward(spec.home)
    middle = np.mean(spec.workspace, axis=1)
    assert pose.translation == pytest.approx([*middle, spec.table_height + 0.35], abs=1e-3)
    _, y, z = pose.rotation.as_matrix().T
    assert z == pytest.approx([0, 0, -1], abs=1e-3)
    assert y == pytest.approx([-1, 0, 0], abs=1e-3)  # what is far from the robot is up in the image


@pytest.mark.parametrize("name", NAMES)
def test_nothing_touches_at_home_nor_in_200_postures_around_it(name):
    spec = ARMS[name]
    model, data = at_home(spec)
    assert contacts(model, data) == set()
    rng = np.random.default_rng(0)
    for _ in range(200):
        for joint, angle in zip(spec.joints, spec.home, strict=True):
            data.joint(joint).qpos = angle + rng.uniform(-0.3, 0.3)
        mujoco.mj_fwdPosition(model, data)
        assert contacts(model, data) == set()


@pytest.mark.parametrize("name", NAMES)
def test_neighboring_links_never_touch_within_the_limits(name):
    spec = ARMS[name]
    model, data = at_home(spec)
    bodies = [model.body(model.jnt_bodyid[model.joint(joint).id]).name for joint in spec.joints]
    neighbors = {frozenset(pair) for pair in pairwise(bodies)}
    low, high = np.array([model.joint(joint).range for joint in spec.joints]).T
    for q in np.random.default_rng(1).uniform(low, high, (300, len(low))):
        for joint, angle in zip(spec.joints, q, strict=True):
            data.joint(joint).qpos = angle
        mujoco.mj_fwdPosition(model, data)
        assert not contacts(model, data) & neighbors


@pytest.mark.parametrize("name", NAMES)
def test_a_folded_arm_does_touch_itself(name):
    # Otherwise the two tests above would pass without any collision geometry.
    spec = ARMS[name]
    model, data = at_home(spec)
    low, high = np.array([model.joint(joint).range for joint in spec.joints]).T
    touching = 0
    for q in np.random.default_rng(2).uniform(low, high, (200, len(low))):
        for joint, angle in zip(spec.joints, q, strict=True):
            data.joint(joint).qpos = angle
        mujoco.mj_fwdPosition(model, data)
        touching += data.ncon > 0
    assert touching > 10


@pytest.mark.parametrize("name", NAMES)
def test_visual_geoms_touch_nothing_and_collision_geoms_are_hidden(name):
    model, _ = at_home(ARMS[name])
    collides = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    assert set(model.geom_group[collides]) == {3}
    assert set(model.geom_group[~collides]) == {2}


@pytest.mark.parametrize("name", NAMES)
def test_the_models_need_no_mesh_file(name):
    model, _ = at_home(ARMS[name])
    assert model.nmesh == model.nhfield == 0


@pytest.mark.parametrize("name", NAMES)
def test_servos_settle_within_a_tenth_of_a_degree(name):
    spec = ARMS[name]
    model, data = at_home(spec)
    servos = [model.actuator(joint).id for joint in spec.joints]
    goal = np.array(spec.home) + np.random.default_rng(4).uniform(-0.3, 0.3, len(spec.home))
    for step in range(2000):
        data.ctrl[servos] = spec.home + min(1.0, step / 1000) * (goal - spec.home)
        mujoco.mj_step(model, data)
    reached = np.array([data.joint(joint).qpos[0] for joint in spec.joints])
    assert np.degrees(np.abs(reached - goal)).max() < 0.1
    assert np.abs(data.qvel).max() < 0.01


def opening(data, gripper: GripperSpec) -> float:
    return float(sum(data.joint(finger).qpos[0] for finger in gripper.finger_joints))


@pytest.mark.parametrize("max_width", [0.072, 0.1, 0.044])
def test_the_gripper_opens_to_its_width_and_closes_by_its_stroke_of_44_mm(max_width):
    spec = ARMS["baxter"]
    gripper = replace(spec.gripper, max_width=max_width)
    spec = replace(spec, gripper=gripper)
    model, data = at_home(spec)
    data.ctrl[[model.actuator(joint).id for joint in spec.joints]] = spec.home
    widths = []
    for command in (max_width, 0.0):
        data.ctrl[model.actuator(gripper.actuator).id] = command
        mujoco.mj_step(model, data, 500)
        widths.append(opening(data, gripper))
    assert widths == pytest.approx([max_width, max_width - 0.044], abs=1e-3)
    first, second = (data.joint(finger).qpos[0] for finger in gripper.finger_joints)
    assert first == pytest.approx(second, abs=1e-4)


def test_the_fingertips_reach_120_mm_beyond_the_range_sensor_and_grasp_around_the_cameras_axis():
    model, data = at_home(ARMS["baxter"])
    sensor, camera, grasp = data.site("ir_sensor"), data.camera("hand_camera"), data.site("grasp")
    axis = sensor.xmat.reshape(3, 3)[:, 2]
    assert axis == pytest.approx(-camera.xmat.reshape(3, 3)[:, 2], abs=1e-9)
    tips = []
    for geom in range(model.ngeom):
        if model.geom_group[geom] == 3 and model.body(model.geom_bodyid[geom]).name.startswith("finger"):
            reach = np.abs(data.geom_xmat[geom].reshape(3, 3).T @ axis) @ model.geom_size[geom]
            tips.append((data.geom_xpos[geom] - sensor.xpos) @ axis + reach)
    assert max(tips) == pytest.approx(0.12, abs=1e-6)
    lens_to_grasp = grasp.xpos - camera.xpos
    assert np.cross(lens_to_grasp, axis) == pytest.approx(np.zeros(3), abs=1e-9)
    # The fingers close along the image's x axis.
    along = model.jnt_axis[model.joint("finger_a").id]
    finger = data.body("finger_a").xmat.reshape(3, 3) @ along
    assert finger == pytest.approx(camera.xmat.reshape(3, 3)[:, 0], abs=1e-9)


def test_open_fingers_leave_a_128_mm_object_at_250_mm_in_view_even_100_px_off_the_center():
    model, data = at_home(ARMS["baxter"])
    camera, focal = data.camera("hand_camera"), 240 / np.tan(np.radians(24.4))
    reach = 100 + 0.064 / 0.25 * focal  # px from the center
    rotation = camera.xmat.reshape(3, 3)
    for geom in range(model.ngeom):
        if not model.body(model.geom_bodyid[geom]).name.startswith(("finger", "gripper")):
            continue
        corners = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T * model.geom_aabb[geom, 3:]
        corners = (corners + model.geom_aabb[geom, :3]) @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        x, _, z = ((corners - camera.xpos) @ rotation).T * [[1], [-1], [-1]]
        ahead = z > 1e-3
        assert (np.abs(x[ahead]) > reach * z[ahead] / focal).all()


def test_a_model_that_is_not_ours_loads_with_a_camera_on_its_tool_and_the_kinematics_work():
    spec = foreign()
    model = spec.load().compile()
    assert np.radians(model.cam_fovy[model.camera("eye").id]) == pytest.approx(np.radians(48.8))
    ik = InverseKinematics(spec)
    pose = ik.forward([0.0, 0.0, 0.0])
    # The tool's z axis is the arm's x axis, straight out at zero angles.
    assert pose.translation == pytest.approx([0.4, 0.0, 0.4], abs=1e-9)
    assert pose.rotation.as_matrix()[:, 2] == pytest.approx([1, 0, 0], abs=1e-9)
    target = ik.forward([0.2, 0.6, 0.4])
    assert ik.solve(target, spec.home) == pytest.approx([0.2, 0.6, 0.4], abs=2e-3)


def test_the_camera_can_be_mounted_on_a_body_and_looks_along_the_optical_z_axis():
    on_body = RigidTransform.from_components([0.1, 0, 0], Rotation.from_euler("y", 90, degrees=True))
    on_site = InverseKinematics(foreign())
    spec = foreign(camera_mount=("c", on_body), fovy=1.0)
    ik = InverseKinematics(spec)
    difference = ik.forward(spec.home).inv() * on_site.forward(spec.home)
    assert difference.as_matrix() == pytest.approx(np.eye(4), abs=1e-9)
    assert spec.load().compile().cam_fovy[0] == pytest.approx(np.degrees(1.0))
    _, data = at_home(spec)
    camera = data.camera("eye")
    assert -camera.xmat.reshape(3, 3)[:, 2] == pytest.approx(ik.forward(spec.home).rotation.as_matrix()[:, 2])


@pytest.mark.parametrize("unit", ["", "pixel"])
def test_a_stated_field_of_view_replaces_the_lens_that_the_model_gives_its_camera(unit):
    size = "320 240" if unit else ".003 .003"
    lens = f'resolution="640 480" sensorsize=".0064 .0048" focal{unit}="{size}" principal{unit}="{size}"'
    model = FOREIGN.replace('<site name="tool"', f'<camera name="eye" {lens}/><site name="tool"')
    stated = foreign(mjcf=model, camera_mount=None, fovy=1.0).load().compile()
    assert stated.cam_fovy[0] == pytest.approx(np.degrees(1.0))
    assert not stated.cam_sensorsize[0].any()
    assert foreign(mjcf=model, camera_mount=None).load().compile().cam_sensorsize[0].all()


def test_keyframes_lamps_and_floors_of_a_foreign_model_stay_behind():
    model = foreign().load().compile()
    assert model.nkey == model.nlight == 0
    assert [model.geom(i).name for i in range(model.ngeom) if model.geom(i).name] == ["stand"]


def test_a_model_loads_from_a_file_as_from_text(tmp_path):
    file = tmp_path / "arm.xml"
    file.write_text(FOREIGN)
    for mjcf in (file, str(file)):
        assert foreign(mjcf=mjcf).load().compile().nq == 3


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"camera_mount": None}, "no camera 'eye'. It has: none; camera_mount can add one"),
        ({"camera_mount": ("hand", LOOKING_ALONG_TOOL)}, "no body or site 'hand'. It has: a, b, c, tool, world"),
        ({"joints": ("turn", "knee", "tip")}, "no joint 'knee'. It has: bend, tip, turn"),
        ({"home": (0.0, 2.2, 0.0)}, "home puts joint 'bend' at 2.2000, outside its range -2.0944 to 2.0944"),
        ({"mjcf": "nowhere/arm.xml"}, "Error opening file 'nowhere/arm.xml'"),
        ({"mjcf": "<mujoco><worldbody>"}, "does not parse"),
        ({"mjcf": FOREIGN.replace('joint="bend"/></actuator>', 'joint="knee"/></actuator>')}, "does not compile"),
        ({"gripper": GripperSpec("grip", ("f",), "beam", "tool", 0.07)}, "no site 'beam'. It has: tool"),
        ({"gripper": GripperSpec("grip", ("f",), "tool", "tool", 0.07)}, "no actuator 'grip'. It has: m"),
    ],
)
def test_a_model_that_lacks_something_is_refused_with_what_it_has(changes, text):
    with pytest.raises(ModelError) as error:
        foreign(**changes).load()
    assert text in str(error.value)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"home": (0.0, 0.0)}, "home has 2 angles for 3 joints"),
        ({"joint_speed": (1.0, 2.0)}, "joint_speed has 2 values for 3 joints"),
        ({"joints": (), "home": ()}, "name the joints that move"),
        ({"fovy": 48.8}, "fovy is between 0 and pi rad"),
    ],
)
def test_a_spec_that_contradicts_itself_is_refused(changes, text):
    with pytest.raises(InvalidParameterError, match=text):
        foreign(**changes)


def test_an_unknown_arm_is_refused_with_the_known_ones():
    with pytest.raises(UnknownNameError, match=r"no arm named 'ur5'. Did you mean 'ur5e'\? Known: baxter, ur5e"):
        arm_spec("ur5")


def test_a_spec_passes_through_arm_spec():
    spec = foreign()
    assert arm_spec(spec) is spec
    assert arm_spec("baxter") is ARMS["baxter"]
