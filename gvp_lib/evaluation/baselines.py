"""What a planner has to beat: to stay, to look straight down (:class:`LookDown`), and to know."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, islice

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.checks import checked
from gvp_lib.evaluation.episodes import RADIUS, canonical_views
from gvp_lib.evaluation.graspable import GripJudge
from gvp_lib.motion.arc import approach
from gvp_lib.motion.arm import EyeInHandArm, Gripper, Hand, Motion, Outcome
from gvp_lib.motion.sighting import Eye, align_with_major_axis, center_on_object
from gvp_lib.perception.segmentation import Segmenter
from gvp_lib.planning.closing import Reading
from gvp_lib.planning.grasp import Grasp, GraspExecutor
from gvp_lib.planning.picking import LookDown
from gvp_lib.planning.plan import Plan
from gvp_lib.simulation.truth import Truth
from gvp_lib.simulation.workcell import WorkCell

__all__ = ["AlignInPlace", "LookDown", "Oracle", "OracleGrasp", "Stay"]

_MOST = 24  # graspable views, of which one is within reach or none


@checked
@dataclass(frozen=True)
class Stay:
    """Baseline that centers the object and stays where it is.

    Parameters
    ----------
    segmenter
        RGB uint8 (H, W, 3) to mask bool (H, W).

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> from gvp_lib.evaluation import Stay
    >>> cell = WorkCell(arm="floating", target="cuboid_1x2", seed=1)
    >>> Stay(cell.segmenter).plan(cell.arm).outcome.value
    'aligned'
    """

    segmenter: Segmenter

    def plan(self, arm: EyeInHandArm) -> Plan:
        """See :class:`gvp_lib.planning.ViewpointPlanner`."""
        eye = Eye(arm, self.segmenter)
        return Plan.standing(eye, center_on_object(eye).outcome)

    def __repr__(self) -> str:
        return "Stay()"


@checked
@dataclass(frozen=True)
class AlignInPlace:
    """Baseline that comes to the radius and turns the wrist along the major axis: all that one view allows.

    Parameters
    ----------
    segmenter
        RGB uint8 (H, W, 3) to mask bool (H, W).
    radius
        Distance from which to look, m.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> from gvp_lib.evaluation import AlignInPlace
    >>> cell = WorkCell(arm="floating", target="cuboid_1x2", seed=1)
    >>> round(abs(AlignInPlace(cell.segmenter).plan(cell.arm).view.blob.orientation), 1)  # its major axis along y
    1.6
    """

    segmenter: Segmenter
    radius: float = RADIUS

    def plan(self, arm: EyeInHandArm) -> Plan:
        """See :class:`gvp_lib.planning.ViewpointPlanner`."""
        eye = Eye(arm, self.segmenter)
        came = approach(eye, self.radius)
        arrived = came.view is not None and came.motion
        motion = align_with_major_axis(eye).motion if arrived else came.motion
        return Plan.standing(eye, motion.reason)

    def __repr__(self) -> str:
        return f"AlignInPlace(radius={self.radius:.3g})"


@checked
@dataclass(frozen=True, eq=False)
class Oracle:
    """Upper bound: go where the truth says, as well as the arm can.

    Parameters
    ----------
    cell
        Work cell of the arm that it moves.
    graspable
        Whether to go where a two-finger hand holds the object (:meth:`GripJudge.views`) rather than to a canonical
        view, which of an odd thing faces its box. Where no such view is found or within reach, it is a canonical one.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> from gvp_lib.evaluation import Oracle, begin, run_episode
    >>> cell = WorkCell(arm="floating", target="cuboid_1x2")
    >>> start = begin(cell, 0)
    >>> _, judged = run_episode(cell, Oracle(cell))
    >>> judged.total < 0.001
    True
    """

    cell: WorkCell
    graspable: bool = False

    def plan(self, arm: EyeInHandArm) -> Plan:
        """See :class:`gvp_lib.planning.ViewpointPlanner`."""
        canonical = canonical_views(self.cell)
        held = islice(GripJudge(self.cell).views(), _MOST) if self.graspable else ()
        motion = Motion(False, Outcome.UNREACHABLE)
        start = arm.joints
        for goal in chain((view.world_from_camera for view in held), canonical):
            motion = arm.move_camera(arm.camera_pose().inv() * goal)
            if motion:
                break
            arm.move_joints(start)
        return Plan.standing(Eye(arm, self.cell.segmenter), motion.reason)


@checked
@dataclass(frozen=True, eq=False)
class OracleGrasp:
    """Upper bound of an executor: without looking, down along the optical axis as far as the truth says, and close.

    Parameters
    ----------
    cell
        Work cell of the arm that it moves.

    Examples
    --------
    >>> from gvp_lib import WorkCell, pick_up
    >>> from gvp_lib.evaluation import Oracle, OracleGrasp
    >>> cell = WorkCell(target="alligator", seed=1)
    >>> planner, executor = Oracle(cell, graspable=True), OracleGrasp(cell)
    >>> plan = planner.plan(cell.arm)
    >>> cell.dynamic = True
    >>> executor.grasp(cell.arm, cell.gripper, plan).outcome.value
    'held'
    """

    cell: WorkCell

    def grasp(self, arm: EyeInHandArm, gripper: Gripper, plan: Plan | None = None) -> Grasp:
        """See :class:`gvp_lib.planning.Executor`."""
        closing = _KnownDepth(self.cell.truth, self.cell.truth.world_from_camera, GripJudge(self.cell).grip().travel)
        return GraspExecutor(_blindly, closing, recenter=None, step=0.01).grasp(arm, gripper)


@dataclass(frozen=True)
class _KnownDepth:
    """Closing rule by the truth: after a way along the optical axis of a view, wherever the arm believes to be."""

    truth: Truth
    world_from_camera: RigidTransform
    travel: float  # m

    def remaining(self, readings: Sequence[Reading], hand: Hand) -> float:
        _, _, gone = (self.world_from_camera.inv() * self.truth.world_from_camera).translation
        return 0.0 if readings[-1].landed else float(self.travel - gone)


def _blindly(rgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """A strip along the image's border: of what is cut off there, a hand on its way asks no more."""
    mask = np.zeros(rgb.shape[:2], bool)
    mask[:4] = True
    return mask
