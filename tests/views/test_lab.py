"""MuJoCo in the page against MuJoCo in Python, on scenes of a laboratory."""

import gzip

import mujoco
import numpy as np
import pytest
from page_scripts import node

from gvp_lib.simulation.workcell import WorkCell
from gvp_lib.views.lab import Lab
from gvp_lib.views.page import to_text
from gvp_lib.views.wasm import mujoco_script

pytestmark = pytest.mark.full
CELLS = [("baxter", "cuboid_1x2", "flat"), ("ur5e", "cylinder", "tilted"), ("baxter", "cylinder", "side")]

# What differs: where texts and textures stand, which the page has not; how exact the bounds of a search for contacts
# are; and two fields that changed between the versions.
OTHERS = ("actuator_ctrlspec", "eq_data", "mat_texid", "bvh_aabb", "name", "tex_")

BEGIN = """
const { gunzipSync } = require("zlib");
const mj = await loadMujoco({ wasmBinary: gunzipSync(Buffer.from(MUJOCO_WASM, "base64")) });
const cell = new simulation.Cell(mj, given.scene, { draw: () => new Uint8Array(4 * 640 * 480) });
"""


def in_page(tmp_path, code, given):
    before = 'globalThis.location = { href: "file:///lab.html" };'
    return node(tmp_path, ["geometry", "simulation"], BEGIN + code, given, before + mujoco_script().read_text("utf-8"))


@pytest.fixture(scope="module", params=CELLS, ids=lambda cell: " ".join(cell))
def cell(request):
    with WorkCell(*request.param, seed=7) as made:
        yield made


def test_a_scene_weighs_little(cell):
    assert len(gzip.compress(to_text(Lab(cell).payload).encode(), 9)) < 20_000


def test_the_models_fields_are_pythons(tmp_path, cell):
    names = [name for name in dir(cell.model) if isinstance(getattr(cell.model, name), np.ndarray) and name[0] != "_"]
    code = """
    const told = {};
    for (const name of given.names) { let each; try { each = cell.model[name]; } catch { continue; }
      if (each !== undefined) told[name] = Array.from(each, Number); }
    console.log(JSON.stringify(told));
    """
    (scene,) = Lab(cell).payload["scenes"].values()
    found = in_page(tmp_path, code, {"scene": scene, "names": names})
    off = {}
    for name, values in found.items():
        ours = np.asarray(getattr(cell.model, name))
        if ours.dtype.kind not in "fiub":
            continue
        ours = ours.ravel().astype(float)
        if len(ours) != len(values):
            off[name] = f"{len(values)} for {len(ours)}"
        elif len(ours) and np.abs(ours - values).max() > 1e-12 * max(1, np.abs(ours).max()):
            off[name] = float(np.abs(ours - values).max())
    assert len(found) > 250
    assert not {name: what for name, what in off.items() if not name.startswith(OTHERS)}


def test_cameras_sites_and_jacobians_are_pythons_to_the_ninth_digit(tmp_path, cell):
    model, data, rng = cell.model, mujoco.MjData(cell.model), np.random.default_rng(0)
    (scene,) = Lab(cell).payload["scenes"].values()
    ids = [model.joint(name).id for name in scene["joints"]]
    low, high = np.clip(model.jnt_range[ids].T, -3, 3)
    poses, expected = rng.uniform(low, high, (30, len(ids))), []
    camera, jacobian = model.camera(scene["camera"]), np.zeros((2, 3, model.nv))
    for q in poses:
        data.qpos[:] = scene["qpos"]
        data.qpos[model.jnt_qposadr[ids]] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_camlight(model, data)
        mujoco.mj_jac(model, data, *jacobian, data.cam_xpos[camera.id], camera.bodyid[0])
        expected.append([*data.site_xpos.ravel(), *data.cam_xpos.ravel(), *data.cam_xmat.ravel(), *jacobian.ravel()])
    code = """
    console.log(JSON.stringify(given.poses.map((q) => {
      cell.setJoints(cell.data, q);
      const at = [...cell.data.cam_xpos.subarray(3 * cell.camera, 3 * cell.camera + 3)];
      mj.mj_jac(cell.model, cell.data, ...cell.jacobian, at, cell.body);
      const jacobian = cell.jacobian.flatMap((each) => [...each.GetView()]);
      return [...cell.data.site_xpos, ...cell.data.cam_xpos, ...cell.data.cam_xmat, ...jacobian];
    })));
    """
    found = in_page(tmp_path, code, {"scene": scene, "poses": poses.tolist()})
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_two_hundred_steps_in_contact_end_where_pythons_do(tmp_path, cell):
    model, data = cell.model, mujoco.MjData(cell.model)
    (scene,) = Lab(cell).payload["scenes"].values()
    data.qpos[:], data.ctrl[:] = scene["qpos"], scene["ctrl"]
    data.mocap_pos[:], data.mocap_quat[:] = cell.data.mocap_pos, cell.data.mocap_quat
    mujoco.mj_step(model, data, 200)
    code = """
    mj.mj_resetData(cell.model, cell.data);
    cell.data.qpos.set(given.scene.qpos); cell.data.ctrl.set(given.scene.ctrl);
    cell.data.mocap_pos.set(given.scene.mocap.pos); cell.data.mocap_quat.set(given.scene.mocap.quat);
    for (let k = 0; k < 200; k++) mj.mj_step(cell.model, cell.data);
    console.log(JSON.stringify([cell.data.ncon, ...cell.data.qpos]));
    """
    found = in_page(tmp_path, code, {"scene": scene})
    assert found[0] == data.ncon > 0
    np.testing.assert_allclose(found[1:], data.qpos, atol=1e-6)
