"""What a planner has to beat: to stay, to look straight down, and to know."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.evaluation.episodes import RADIUS, canonical_views
from gvp_lib.motion.arc import approach
from gvp_lib.motion.arm import Motion, Outcome
from gvp_lib.motion.centering import align_with_major_axis, center_on_object
from gvp_lib.motion.sighting import Eye
from gvp_lib.planning.plan import Plan
from gvp_lib.simulation.workcell import WorkCell

__all__ = ["aligned_in_place", "look_down", "oracle", "stay"]


def stay(cell: WorkCell) -> Plan:
    """Center the object, and stay."""
    eye = Eye(cell.arm, cell.segmenter)
    return _finished(eye, center_on_object(eye).motion)


def aligned_in_place(cell: WorkCell) -> Plan:
    """Come to the radius, turn the wrist along the major axis, and stay: all that one view allows."""
    eye = Eye(cell.arm, cell.segmenter)
    came = approach(eye, RADIUS)
    arrived = came.view is not None and came.motion
    return _finished(eye, align_with_major_axis(eye).motion if arrived else came.motion)


def look_down(cell: WorkCell) -> Plan:
    """Look straight down on the object, along the major axis of what is seen from there: the usual top-down grasp."""
    arm, eye = cell.arm, Eye(cell.arm, cell.segmenter)
    came = approach(eye, RADIUS)
    if came.view is None or not came.motion:
        return _finished(eye, came.motion)
    here, down = arm.camera_pose(), np.array([0.0, 0.0, -1.0])
    turn, _ = Rotation.align_vectors([down], [here.rotation.as_matrix()[:, 2]])
    goal = RigidTransform.from_components(here.apply([0.0, 0.0, RADIUS]) - RADIUS * down, turn * here.rotation)
    eye.expect(None)
    motion = arm.move_camera(here.inv() * goal)
    if motion:
        align_with_major_axis(eye)
        motion = center_on_object(eye, depth=RADIUS).motion
    return _finished(eye, motion)


def oracle(cell: WorkCell) -> Plan:
    """Go where the truth says, as well as the arm can: what its own errors and reach leave to gain."""
    motion = Motion(False, Outcome.UNREACHABLE)
    start = cell.arm.joints
    for goal in canonical_views(cell):
        motion = cell.arm.move_camera(cell.arm.camera_pose().inv() * goal)
        if motion:
            break
        cell.arm.move_joints(start)
    return _finished(Eye(cell.arm, cell.segmenter), motion)


def _finished(eye: Eye, motion: Motion) -> Plan:
    eye.expect(None)
    view = eye.look()
    outcome = Outcome.ALIGNED if motion else motion.reason
    return Plan(Outcome.TARGET_LOST if motion and view is None else outcome, (), (), view, eye.looks)
