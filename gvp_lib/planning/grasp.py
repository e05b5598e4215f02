"""Grasp completion: down along the lens, the object kept in the middle, close, lift. Thesis 2.3, Grasp Completion.

Where the fingers close is for a rule to say: see :mod:`gvp_lib.planning.closing`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import check_fields, checked
from gvp_lib.motion.arm import EyeInHandArm, Gripper, Motion, Outcome
from gvp_lib.motion.primitives import toward_pixel, turn
from gvp_lib.motion.sighting import Eye, View, missing_roll
from gvp_lib.perception.segmentation import Segmenter
from gvp_lib.picture import Pictured, brief, count
from gvp_lib.planning.closing import CLEARANCE, ENOUGH, AtGrip, ClosingRule, RangeThreshold, Reading, SizedDepth
from gvp_lib.planning.grips import Grip
from gvp_lib.planning.plan import Plan

__all__ = ["Grasp", "GraspExecutor"]

_HEIGHT = 0.10  # m, of a lift
_SHUT = 0.001  # m, by which fingers with something between them stand wider than shut
_STUCK = 0.001  # m, by which fingers that move at all have moved
_FULL_AXIS = 4 / np.sqrt(12)  # of a rectangle's side, as moments measure it (errata 5)
_CLOSE_ENOUGH = 0.0005  # m to go, at which the hand is there
_PATIENCE = 20  # readings, once a finger has touched down
_SHALLOW, _DEEPER = 0.3, 0.5  # of the rule's depth: what just holds, and what a lean is to make possible
_STANDS = 0.015  # m, from the solid's lowest corner, within which a finger touched what the object stands on
_LETS_GO = 5  # commands, by which an arm that pressed on something has let go of it
_LEAN = np.radians(1.0)  # step in which a lean is tried
_FARTHER = 0.015  # m, by which a hand goes down that closed on nothing, to close anew
_ROOM = 0.010  # m, that the open fingers have to spare where the hand turns by a quarter


@dataclass(frozen=True, eq=False)
class Grasp(Pictured):
    """Finished grasp.

    Attributes
    ----------
    outcome
        How it ended, as far as the hand can tell.
    readings
        Readings of the range sensor on the way down, one at each increment; of the last descent, where there were two.
    view
        Last view on the way down; None where the object was never in sight.
    width
        Width between the pads after closing, m; NaN where the fingers did not close.
    landed
        Whether a finger touched something on the way down, which ended it.
    closed_at
        Camera's pose ``base_from_camera`` where the fingers closed, as the arm believes; None where they did not.
    frames
        Pictures taken.
    lean
        Angle by which the hand leaned back from the plan's direction, for its fingers to clear what the object stands
        on, rad.
    """

    _figure = "plot_grasp"

    outcome: Outcome
    readings: tuple[Reading, ...]
    view: View | None
    width: float
    landed: bool
    closed_at: RigidTransform | None
    frames: int
    lean: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "outcome", Outcome(self.outcome))

    @property
    def held(self) -> bool:
        """Whether something is between the fingers after the lift."""
        return self.outcome is Outcome.HELD

    def __repr__(self) -> str:
        width = f", fingers {1000 * self.width:.0f} mm apart" if np.isfinite(self.width) else ""
        lean = f", leaned back {np.degrees(self.lean):.0f} deg" if self.lean else ""
        readings = count(len(self.readings), "range reading")
        return f"Grasp({self.outcome}{width}{lean}, {readings}, {count(self.frames, 'picture')})"


@checked
@dataclass(frozen=True)
class GraspExecutor:
    """Completes a grasp from where a viewpoint planner has left the camera. Thesis 2.3.

    The hand descends along the lens in increments. At each it reads the range sensor and brings the object back to the
    middle of the image, until the object touches the image's border. Where the closing rule says so, it closes the
    fingers and lifts: straight up, or where the arm cannot, back the way it came. Once a finger touches something the
    hand stays, the sensor is read a few times more, and the rule may still close.

    Where the object leans steeply, a finger may meet what it stands on before the pads have anything to hold. If the
    fingers then close on nothing, the hand goes back up, takes that touch for a point of a level plane, and comes down
    anew: turned by a quarter, where the solid is narrow enough that way too, or leaned back toward the vertical, about
    the axis across the fingers, by no more than they need. It takes :class:`SizedDepth` with a solid. A plane that is
    known (``support``) spares it the touch. Where they close on nothing though no finger touched anything, as about a
    bottle's neck, the hand goes down farther, as long as there is room below its palm, and closes anew.

    The defaults hold best; :meth:`thesis` has the thesis's rule and its recentering.

    Parameters
    ----------
    segmenter
        RGB uint8 (H, W, 3) to mask bool (H, W).
    closing
        Rule when to close; None: by the solid of the plan and all range readings (:meth:`SizedDepth.of`), or where a
        plan has a :class:`Grip`, as deep as that says, straight down and by what the arm believes.
    step
        Step of the descent, m, at most 0.01: nearer the object a longer one would make it leap in the image.
    recenter
        ``"shifting"``, which keeps the direction of view; ``"turning"``, as Algorithm 1 does; or None.
    realign
        Whether to turn the wrist along the major axis at each increment as well. The thesis found no need.
    threshold
        Largest offset that is left alone, px.
    distance
        Distance of the object's center when the descent begins, m: the planner's radius.
    limit
        Longest descent, m.
    support
        Plane that the fingers may not cross: its height in the arm's base frame, m, or a point and its upward normal,
        shape (2, 3). None: unknown, until a finger touches it.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> cell = WorkCell(target="cuboid_1x2", placement="raised", dynamic=True, seed=3)
    >>> GraspExecutor(cell.segmenter).grasp(cell.arm, cell.gripper).outcome.value
    'held'
    """

    segmenter: Segmenter
    closing: ClosingRule | None = None
    step: float = 0.005
    recenter: Literal["turning", "shifting"] | None = "shifting"
    realign: bool = False
    threshold: float = 3.0
    distance: float = 0.25
    limit: float = 0.30
    support: ArrayLike | None = None

    __repr__ = brief

    def __post_init__(self) -> None:
        rule = "a rule with a method remaining(readings, hand), as RangeThreshold() and SizedDepth() have, or None"
        check_fields(
            self,
            {"threshold": "in px", "distance": "in m", "limit": "in m"},
            closing=(self.closing is None or isinstance(self.closing, ClosingRule), rule),
            recenter=(self.recenter in ("turning", "shifting", None), '"turning", "shifting" or None'),
            step=(0 < self.step <= 0.01, "positive and at most 0.01 m"),
            support=(
                lambda plane: plane is None or _plane(plane) is not None,
                "a height in the arm's base frame, m, or a point and an upward normal, shape (2, 3), or None",
            ),
        )
        if self.support is not None:  # an array would be neither equal to another nor fit for a line of text
            given = np.asarray(self.support, float).tolist()
            object.__setattr__(self, "support", tuple(map(tuple, given)) if isinstance(given, list) else given)

    @classmethod
    def thesis(cls, segmenter: Segmenter, **options: Any) -> GraspExecutor:
        """Thesis's executor: close at the first reading below 10 cm, and recenter by turning.

        Parameters
        ----------
        segmenter
            RGB uint8 (H, W, 3) to mask bool (H, W).
        **options
            Other parameters of the class.
        """
        return cls(segmenter, **{"closing": RangeThreshold(), "recenter": "turning", **options})

    def grasp(self, arm: EyeInHandArm, gripper: Gripper, plan: Plan | None = None) -> Grasp:
        """Open, descend, close, and lift.

        Where the fingers do not close, the hand stays where it stopped.

        Parameters
        ----------
        arm, gripper
            Arm that stands where it should look from, and the gripper at its camera.
        plan
            Plan that brought the camera there: its view shows which of several alike objects is the target, and its
            solid how deep to go. Without one the target is the object nearest the middle of the image.
        """
        run = _Run(self, arm, gripper, plan)
        outcome = run.take() or run.lift()
        return Grasp(
            outcome, tuple(run.readings), run.view, run.width, run.landed, run.closed_at, run.eye.looks, run.lean
        )


def once_free(move: Callable[[], Motion], tries: int = _LETS_GO) -> Motion:
    """Move as asked, again where a contact stops it: an arm that presses on something may stop before it has let go."""
    for _ in range(tries):
        motion = move()
        if motion.reason is not Outcome.CONTACT:
            break
    return motion


def _plane(support: ArrayLike) -> tuple[NDArray[np.float64], float] | None:
    """Upward unit normal of a plane, and its distance from the base's origin along it; None where it is no plane."""
    given = np.asarray(support, float)
    if given.shape == ():
        given = np.array([[0.0, 0.0, given], [0.0, 0.0, 1.0]])
    if given.shape != (2, 3) or not np.isfinite(given).all() or not given[1, 2] > 0:
        return None
    point, normal = given
    up = normal / np.linalg.norm(normal)
    return up, float(up @ point)


class _Run:
    """One grasp in the making."""

    def __init__(self, executor: GraspExecutor, arm: EyeInHandArm, gripper: Gripper, plan: Plan | None) -> None:
        self.executor, self.arm, self.gripper = executor, arm, gripper
        known = SizedDepth() if plan is None else SizedDepth.of(plan)
        grips = plan.grips if plan is not None and executor.closing is None else ()
        self.grip = grips[0] if grips else None
        # What to try where a finger came down on something beside the object: other grips, or turns of the hand, rad.
        turns = [np.pi / 2] if known.solid is None or known.solid.kind == "box" else [np.pi / 2, np.pi / 4, -np.pi / 4]
        self.others: list[Grip] | list[float] = list(grips[1:]) if grips else turns
        self.fitted, self.closing = known.solid, executor.closing or (AtGrip(self.grip) if self.grip else known)
        self.sized = self.closing if isinstance(self.closing, SizedDepth) else known
        self.eye = Eye(arm, executor.segmenter)
        if plan is not None and plan.view is not None:
            self.eye.tracker.expect(plan.view.blob)
        self.hand, self.stroke = gripper.hand, gripper.stroke
        self.readings: list[Reading] = []
        self.way: list[NDArray[np.float64]] = []  # joints, for the way back
        self.view: View | None = None
        self.width, self.closed_at, self.lean = np.nan, None, 0.0
        self.known = None if executor.support is None else _plane(executor.support)
        self.plane = self.known

    @property
    def landed(self) -> bool:
        """Whether a finger touched something on the way down."""
        return bool(self.readings) and self.readings[-1].landed

    def take(self) -> Outcome | None:
        """Down, and the fingers closed; None where something is between them, or why not."""
        self.gripper.open()
        self.view = self.eye.look()
        if self.view is None:
            return Outcome.TARGET_NOT_FOUND
        if self._must_span() > self.stroke[1]:
            return Outcome.TOO_WIDE
        ended = self._turn_by(self._ways()) or self._down() or self._close()
        while ended is Outcome.EMPTY and self.executor.closing is None:
            if self.landed and (ways := self._ways()):
                self._let_go()
                ended = self._back(_LETS_GO) or self._turn_by(ways) or self._down() or self._close()
            elif self.landed and self.others:
                self._let_go()
                ended = self._back(_LETS_GO) or self._otherwise() or self._down() or self._close()
            elif self._may_go_deeper():
                self._let_go()
                ended = self._deeper() or self._close()
            else:
                break
        return ended

    def _must_span(self) -> float:
        """Width that the open fingers must span, m."""
        assert self.view is not None
        if self.grip is not None:
            return self.grip.width
        depth = min(self.executor.distance, self.hand.sensor + self.gripper.range())
        solid, here = self.fitted, self.view.base_from_camera
        if solid is not None:
            return solid.span(here, solid.surface_from(here) + self.sized.depth, self.hand.breadth)
        # Nobody knows more than the blob: its minor axis at the distance by the sensor, at most the planner's radius.
        return float(self.view.blob.axis_minor_length / _FULL_AXIS * depth / self.eye.intrinsics.fx)

    def _down(self) -> Outcome | None:
        """Down from where the hand looks at the object; None where the rule closes, or why not."""
        assert self.view is not None
        executor = self.executor
        gone, in_sight = 0.0, self.grip is None and not self.view.clipped  # a grip need not be in the object's middle
        while True:
            to_go, allowed = self._read(), executor.limit - gone
            if to_go < _CLOSE_ENOUGH:
                return None
            if allowed < _CLOSE_ENOUGH:
                return Outcome.NEVER_CLOSED
            self.way.append(self.arm.joints)
            step = min(executor.step, to_go, allowed)
            aim = self._aim(self.view, gone) if in_sight else RigidTransform.identity()
            motion = self.arm.move_camera(aim * RigidTransform.from_translation([0.0, 0.0, step]))
            if motion.reason is Outcome.CONTACT:  # the hand stays; the next reading may be another
                closes = any(self._read(landed=True) < _CLOSE_ENOUGH for _ in range(_PATIENCE))
                return None if closes else Outcome.NEVER_CLOSED
            if not motion:
                return motion.reason
            gone += step
            if in_sight:
                recentered = executor.recenter is not None
                seen = self.eye.look(self.eye.intrinsics.principal_point if recentered else self.view.blob.centroid)
                if seen is None:
                    return Outcome.TARGET_LOST
                self.view, in_sight = seen, not seen.clipped

    def _may_go_deeper(self) -> bool:
        """Whether the hand can go down farther about what was too narrow for its fingers."""
        here = self.arm.camera_pose()
        nearest = self.hand.sensor + float(np.median([self.gripper.range() for _ in range(ENOUGH)]))
        above = np.inf if self.plane is None else self._clear(here)
        began = self.readings[0].base_from_camera.translation
        left = self.executor.limit - float(np.linalg.norm(here.translation - began))
        return not self.landed and left > _FARTHER and min(nearest - self.hand.palm, above) > _FARTHER + CLEARANCE

    def _deeper(self) -> Outcome | None:
        """Some way down, or until a finger touches something; why not, where the arm cannot."""
        for _ in range(int(np.ceil(_FARTHER / self.executor.step))):
            self.way.append(self.arm.joints)
            motion = self.arm.move_camera(RigidTransform.from_translation([0.0, 0.0, self.executor.step]))
            self.readings.append(
                Reading(self.arm.camera_pose(), self.gripper.range(), motion.reason is Outcome.CONTACT)
            )
            if self.landed:
                break
            if not motion:
                return motion.reason
        return None

    def _read(self, landed: bool = False) -> float:
        here = self.arm.camera_pose()
        self.readings.append(Reading(here, self.gripper.range(), landed))
        to_go = self.closing.remaining(self.readings, self.hand)
        if self.plane is None:
            return to_go
        sinking = -float(self.plane[0] @ here.rotation.as_matrix()[:, 2])
        return min(to_go, (self._clear(here) - CLEARANCE) / sinking) if sinking > 0 else to_go

    def _aim(self, view: View, gone: float) -> RigidTransform:
        """``camera_from_target`` that brings the object back to the middle, and its major axis onto y."""
        intrinsics = self.eye.intrinsics
        offset = view.blob.centroid - intrinsics.principal_point
        aim = RigidTransform.identity()
        if self.executor.recenter is not None and np.abs(offset).max() > self.executor.threshold:
            if self.executor.recenter == "turning":
                aim = RigidTransform.from_rotation(toward_pixel(intrinsics, view.blob.centroid))
            else:
                depth = max(self.executor.distance - gone, self.hand.palm + 0.05)
                aim = RigidTransform.from_translation([*(offset * depth / (intrinsics.fx, intrinsics.fy)), 0.0])
        roll = missing_roll(view.blob.orientation) if self.executor.realign else np.nan
        return aim * turn([0.0, 0.0, roll]) if abs(roll) > np.radians(1.0) else aim  # not where it is undefined

    # --- what the object stands on ---

    def _clear(self, camera: RigidTransform) -> float:
        """Height of the open fingertips' lowest corner above the plane, m."""
        assert self.plane is not None
        up, offset = self.plane
        across, along, ahead = up @ camera.rotation.as_matrix()
        half = 0.5 * self.stroke[1] + self.hand.thickness
        reach = self.hand.tips * ahead - half * abs(across) - 0.5 * self.hand.breadth * abs(along)
        return float(up @ camera.translation + reach - offset)

    def _ways(self) -> list[tuple[float, RigidTransform]]:
        """Leans, rad, and camera poses from which the fingers clear what the object stands on, best first; none where
        nothing is in their way, or nobody knows what is."""
        solid = self.sized.solid
        if solid is None or self.closing is not self.sized or (self.plane is None) is not self.landed:
            return []
        begin = self.arm.camera_pose()
        ahead = solid.surface_from(begin)
        if self.landed:
            self.plane = np.eye(3)[2], 0.0
            self.plane = np.eye(3)[2], self._clear(begin)
            if self.plane[1] > solid.corners[:, 2].min() + _STANDS:  # it has touched the object, or something beside it
                self.plane = None
                return []
            # From above where it came to, which is nearer the middle of the object than where it began.
            gone = begin.rotation.inv().apply(begin.translation - self.readings[0].base_from_camera.translation)[2]
            begin *= RigidTransform.from_translation([0.0, 0.0, -gone])
            ahead = self.sized.surface(self.readings, self.hand) + gone
        about = RigidTransform.from_translation([0.0, 0.0, ahead])

        def room(goal: RigidTransform, share: float) -> float:
            """By how much the fingertips clear the plane where they are as deep as a share of what the rule wants."""
            down = ahead + share * self.sized.depth - self.hand.tips
            return self._clear(goal * RigidTransform.from_translation([0.0, 0.0, down])) - CLEARANCE

        if not self.landed and room(begin, _SHALLOW) >= 0:
            return []
        assert self.plane is not None
        ways = []
        for quarter in (0.0, 0.5 * np.pi, -0.5 * np.pi):
            turned = begin.rotation * Rotation.from_rotvec([0.0, 0.0, quarter])
            across, _, sinking = self.plane[0] @ turned.as_matrix()
            full = np.arctan2(-across, -sinking)  # there the fingers close along the plane
            for lean in np.linspace(0.0, full, 2 + int(abs(full) / _LEAN)):
                goal = begin * about * turn([0.0, 0.0, quarter]) * turn([0.0, lean, 0.0]) * about.inv()
                if (free := room(goal, _DEEPER)) >= 0:
                    break
            wide = solid.span(goal, ahead + self.sized.depth, self.hand.breadth)
            helps = min(0.0, free) > room(begin, _DEEPER) + CLEARANCE
            if helps and wide <= self.stroke[1] - (_ROOM if quarter else 0.0):
                ways.append((max(0.0, -free), abs(float(lean)), abs(quarter), goal))
        return [(lean, goal) for _, lean, _, goal in sorted(ways, key=lambda way: way[:3])]

    def _turn_by(self, ways: Sequence[tuple[float, RigidTransform]]) -> Outcome | None:
        """Go where the first of the ways begins that can be reached; why not, where it ends there."""
        if not ways:
            return None
        start, joints = self.arm.camera_pose(), self.arm.joints
        for lean, goal in ways:
            if self.arm.move_camera(start.inv() * goal):
                self.lean = lean
                break
            if not (motion := self.arm.move_joints(joints)):
                return motion.reason
        else:
            self.plane = self.known  # as far as at first
        return self._begin_anew()

    def _otherwise(self) -> Outcome | None:
        """Go where the next other way to grip begins that can be reached; why not, where it ends there."""
        start, joints, solid = self.arm.camera_pose(), self.arm.joints, self.sized.solid
        while self.others:
            other = self.others.pop(0)
            if isinstance(other, Grip):
                view = other.view(self.executor.distance)
                rolls = [view, view * turn([0.0, 0.0, np.pi])]
                goals = sorted(rolls, key=lambda goal: float((start.inv() * goal).rotation.magnitude()))
            else:
                goals = [start * turn([0.0, 0.0, angle]) for angle in (other, other - np.copysign(np.pi, other))]
                deep = np.inf if solid is None else solid.surface_from(start) + self.sized.depth
                if solid is None or solid.span(goals[0], deep, self.hand.breadth) > self.stroke[1] - _ROOM / 2:
                    continue
            for goal in goals:
                if self.arm.move_camera(start.inv() * goal):
                    if isinstance(other, Grip):
                        self.grip, self.closing = other, AtGrip(other)
                    return self._begin_anew()
                if not (motion := self.arm.move_joints(joints)):
                    return motion.reason
        return Outcome.EMPTY

    def _begin_anew(self) -> Outcome | None:
        self.way, self.readings = [], []  # of a sensor that looked along another line
        self.eye.expect(None)
        seen = self.eye.look()
        self.view = seen or self.view
        return None if seen else Outcome.TARGET_LOST

    def _back(self, tries: int = 1) -> Outcome | None:
        """Back the way it came; why not, where something is in the way."""
        for q in reversed(self.way):
            if not (motion := once_free(partial(self.arm.move_joints, q), tries)):
                return motion.reason
        return None

    def _let_go(self) -> None:
        self.gripper.open()
        self.width, self.closed_at = np.nan, None

    def _close(self) -> Outcome | None:
        """Close the fingers; None where something is between them."""
        shut, wide = self.stroke
        self.closed_at = self.arm.camera_pose()
        self.gripper.close()
        self.width = self.gripper.width
        if self.width > wide - _STUCK:
            return Outcome.JAMMED
        return Outcome.EMPTY if self.width < shut + _SHUT else None

    def lift(self) -> Outcome:
        """Straight up, or back the way it came; and whether it is still there."""
        up = self.arm.camera_pose().rotation.inv().apply([0.0, 0.0, _HEIGHT])  # the base's z, as the camera sees it
        motion = self.arm.move_camera(RigidTransform.from_translation(up))
        if not motion and (stopped := self._back() if self.way else motion.reason):
            return stopped
        return Outcome.SLIPPED if self.gripper.width < self.stroke[0] + _SHUT else Outcome.HELD
