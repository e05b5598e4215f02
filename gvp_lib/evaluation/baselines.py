"""What a planner has to beat: to stay, to look straight down (:class:`LookDown`), and to know."""

from __future__ import annotations

from dataclasses import dataclass

from gvp_lib.checks import checked
from gvp_lib.evaluation.episodes import RADIUS, canonical_views
from gvp_lib.motion.arc import approach
from gvp_lib.motion.arm import EyeInHandArm, Motion, Outcome
from gvp_lib.motion.sighting import Eye, align_with_major_axis, center_on_object
from gvp_lib.perception.segmentation import Segmenter
from gvp_lib.planning.picking import LookDown
from gvp_lib.planning.plan import Plan
from gvp_lib.simulation.workcell import WorkCell

__all__ = ["AlignInPlace", "LookDown", "Oracle", "Stay"]


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

    def plan(self, arm: EyeInHandArm) -> Plan:
        """See :class:`gvp_lib.planning.ViewpointPlanner`."""
        motion = Motion(False, Outcome.UNREACHABLE)
        start = arm.joints
        for goal in canonical_views(self.cell):
            motion = arm.move_camera(arm.camera_pose().inv() * goal)
            if motion:
                break
            arm.move_joints(start)
        return Plan.standing(Eye(arm, self.cell.segmenter), motion.reason)
