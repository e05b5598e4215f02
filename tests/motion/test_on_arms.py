"""Arcs and approaches on the simulated arms, with noise and without."""

import numpy as np
import pytest
from arc_checks import check_order
from cells import Cells
from eye_in_hand import CAMERA
from scipy.spatial.transform import RigidTransform

from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.motion.arc import approach, traverse_arc
from gvp_lib.motion.arm import Outcome
from gvp_lib.motion.primitives import toward_pixel
from gvp_lib.motion.sighting import Eye, center_on_object
from gvp_lib.simulation.sensors import Noise

ARMS = ["floating", "ur5e", "baxter"]


@pytest.fixture(scope="module")
def cell_of():
    cells = Cells()
    yield cells
    cells.close()


def centered(cell, tilt_deg=0.0, radius=0.25):
    """An eye from where an arc begins."""
    sphere = VirtualSphere(cell.truth.world_from_object.translation, radius)
    cell.place_camera(sphere.viewpoint(np.radians(tilt_deg), 0.0))
    eye = Eye(cell.arm, cell.segmenter)
    assert center_on_object(eye)
    return eye


@pytest.mark.parametrize(
    ("arm", "noise", "within"),
    [
        ("floating", Noise.none(), 0.04),
        ("baxter", Noise.thesis(), 0.08),
        pytest.param("ur5e", Noise.thesis(), 0.08, marks=pytest.mark.full),
    ],
)
def test_the_true_radius_is_held_and_every_view_centered_on_every_arm(arm, noise, within, cell_of):
    cell, places = cell_of(arm, noise=noise, seed=0), []
    eye = centered(cell, tilt_deg=20)
    arc = traverse_arc(eye, enough=lambda views: bool(places.append(cell.truth.world_from_camera.translation)))
    assert len(arc) > 10
    radii = np.linalg.norm(places - cell.truth.world_from_object.translation, axis=1)
    np.testing.assert_allclose(radii, 0.25, rtol=within)
    np.testing.assert_allclose([view.blob.centroid - CAMERA.principal_point for view in arc.views], 0, atol=2)


@pytest.mark.parametrize(
    ("arm", "axis", "ends"),
    [
        ("ur5e", "y", (Outcome.COLLISION, Outcome.UNREACHABLE)),
        ("baxter", "y", (Outcome.COLLISION, Outcome.JOINT_LIMIT)),
        pytest.param("ur5e", "x", (Outcome.COLLISION, Outcome.COLLISION), marks=pytest.mark.full),
        pytest.param("baxter", "x", (Outcome.UNREACHABLE, Outcome.JOINT_LIMIT), marks=pytest.mark.full),
    ],
)
def test_a_real_arm_ends_at_its_limits_and_at_the_table_and_returns(arm, axis, ends, cell_of):
    cell = cell_of(arm, "cuboid_1x4", seed=0)
    eye, move = centered(cell), cell.arm.move_joints
    before = cell.arm.joints
    arc = traverse_arc(eye, axis, max_angle=np.radians(120))
    assert arc.ends == ends
    check_order(arc)
    np.testing.assert_allclose(cell.arm.joints, before, atol=1e-12)
    # What it says was really in the way: from the last view of each side the next step fails for the same reason.
    for sign, end, side in ((-1, ends[0], arc.views[arc.center :: -1]), (1, ends[1], arc.views[arc.center :])):
        assert all(move(joints) for joints in (before, *(view.joints for view in side)))
        step = [0.0, sign * 0.02, 0.0] if axis == "y" else [sign * 0.02, 0.0, 0.0]
        motion = cell.arm.move_camera(RigidTransform.from_translation(step))
        if motion:  # then it was the turn back toward the object
            away = toward_pixel(CAMERA, eye.look().blob.centroid)
            motion = cell.arm.move_camera(RigidTransform.from_rotation(away))
        assert motion.reason is end
        for view in side[::-1]:
            move(view.joints)


@pytest.mark.parametrize("arm", ARMS)
def test_the_approach_works_on_every_arm_under_the_thesiss_noise(arm, cell_of):
    for seed in range(2):
        cell = cell_of(arm, noise=Noise.thesis(), seed=seed)
        assert approach(centered(cell, radius=0.32), 0.25).motion
        away = cell.truth.world_from_camera.translation - cell.truth.world_from_object.translation
        assert np.linalg.norm(away) == pytest.approx(0.25, rel=0.1)
