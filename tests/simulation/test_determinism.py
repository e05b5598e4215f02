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

arm, noise = sys.argv[1], Noise.thesis()
cell = WorkCell(arm=arm, target="cuboid_1x4", placement="tilted", others=["alligator"], noise=noise)
for seed in (11, 12):
    cell.reset(seed)
    frames, truth = hashlib.sha256(), hashlib.sha256()
    for k in range(3):
        frames.update(cell.arm.capture().tobytes())
        for pose in (cell.truth.world_from_object, cell.truth.world_from_camera, cell.arm.camera_pose()):
            truth.update(pose.as_matrix().tobytes())
        truth.update(np.array([cell.truth.viewpoint_error(), cell.truth.roll_error(), cell.time]).tobytes())
        if arm == "baxter":
            truth.update(np.float64(cell.gripper.range()).tobytes())
        assert cell.arm.move_camera(RigidTransform.from_translation([0.01, -0.01, 0.02]))
    print(frames.hexdigest(), truth.hexdigest())
"""


def in_a_fresh_process(arm: str, hash_seed: int) -> list[str]:
    """Hashes of the frames and of the truth of two episodes."""
    environment = {**os.environ, "PYTHONHASHSEED": str(hash_seed)}
    ran = subprocess.run(
        [sys.executable, "-c", EPISODE, arm], env=environment, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr
    return ran.stdout.split()


@pytest.mark.full
@pytest.mark.parametrize("arm", ARMS)
def test_fresh_processes_give_the_same_frames_and_truth_to_the_bit(arm):
    first = in_a_fresh_process(arm, hash_seed=1)
    assert len(set(first)) == 4
    assert in_a_fresh_process(arm, hash_seed=2) == first
