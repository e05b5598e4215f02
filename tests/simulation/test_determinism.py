"""The same seed in another process: no state of this one, no hash's order, no clock has a say."""

import os
import subprocess
import sys

import pytest

from gvp_lib.simulation.arms import ARMS

EPISODE = """
import hashlib, sys
import numpy as np
from scipy.spatial.transform import RigidTransform
from gvp_lib import Noise, WorkCell

cell = WorkCell(sys.argv[1], "cuboid_1x4", "tilted", others=["alligator"], noise=Noise.thesis())
for seed in (11, 12):
    cell.reset(seed)
    seen = hashlib.sha256()
    for _ in range(3):
        seen.update(cell.arm.capture().tobytes())
        poses = cell.truth.world_from_object, cell.truth.world_from_camera, cell.arm.camera_pose()
        seen.update(np.array([pose.as_matrix() for pose in poses]).tobytes())
        ranged = cell.gripper.range() if cell.arm_spec.gripper else 0.0
        seen.update(np.array([cell.truth.viewpoint_error(), cell.truth.roll_error(), cell.time, ranged]).tobytes())
        assert cell.arm.move_camera(RigidTransform.from_translation([0.01, -0.01, 0.02]))
    print(seen.hexdigest())
"""


@pytest.mark.full
@pytest.mark.parametrize("arm", ARMS)
def test_fresh_processes_give_the_same_frames_and_truth_to_the_bit(arm):
    command = [sys.executable, "-c", EPISODE, arm]
    first, again = (
        subprocess.check_output(command, env={**os.environ, "PYTHONHASHSEED": seed}).split() for seed in "12"
    )
    assert len(set(first)) == 2
    assert again == first
