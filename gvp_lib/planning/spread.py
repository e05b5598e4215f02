"""A planner that looks at the object from a handful of directions, far apart, until it is certain of what it sees.

An arc's views resemble each other, so that many say little more than a few. Views that are far apart each tell
something new, and from about six of them a solid is known as well as from dozens along two arcs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import A_SEGMENTER, check_fields, check_part, checked, lacking
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.motion.arc import Arc
from gvp_lib.motion.arm import EyeInHandArm, Motion, Outcome
from gvp_lib.motion.primitives import estimate_depth
from gvp_lib.motion.sighting import Eye, View, center_on_object, meeting_point
from gvp_lib.perception.segmentation import Segmenter
from gvp_lib.picture import brief
from gvp_lib.planning.attempt import Attempt, saw_nothing, with_wrist_turned
from gvp_lib.planning.contours import ContourFit
from gvp_lib.planning.plan import MIN_VIEWS, Optimum, Plan, ViewpointEstimator

__all__ = ["SpreadViews"]

Array = NDArray[np.float64]

_CANDIDATES = 120  # directions, evenly over the cap
_APART = np.radians(12.0)  # at least, between two views
_NEARLY = 0.8  # of the largest distance from all that was seen is far enough, where it is nearer to go there
_TRIES = 12  # directions, for one more view
_IN_VAIN = 2  # more views than the fewest, after which an object that nothing explains is left unexplained
_ROUGHLY = 30.0  # px: a view need not be centered, but whole
_STEP = 0.03  # m, to a side
_SIDES = (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)


@checked(own=True)
@dataclass(frozen=True)
class SpreadViews:
    """Planner that goes from view to view over the sphere, each far from those before, and then to the best one.

    It turns toward the object and steps aside, which tells about where the object is; from then on one picture is
    enough for a view. The next view is always about the farthest from all before, and of those the nearest to go to, so
    that the way is short. Where the arm stops early, it looks from there. It ends when the estimator is certain enough.

    Parameters
    ----------
    segmenter
        RGB uint8 (H, W, 3) to mask bool (H, W).
    estimator
        Finder of the best viewpoint in the views, which it is given as one :class:`gvp_lib.motion.Arc` without an axis;
        by default :class:`ContourFit`.
    radius
        Radius of the virtual sphere, m.
    spread
        Largest angle of a view from the first, rad.
    until
        Standard deviation of the direction of view at which it stops, rad.
    fewest, most
        Number of views from which on it may stop, and at which it does.
    following
        Which view comes next: ``"spread"``, about the farthest from all before; or, once a solid explains those,
        ``"covariance"``, the one from which its normal would be best known. Then the estimator needs a method
        ``foreseen``, as :class:`ContourFit` has.
    threshold
        Largest offset after the last centering, px.
    keep_images
        Whether the trace keeps the pictures (0.9 MB each).
    wrist_retries
        Turns of the wrist with which to begin again, rad, one after the other, where the arm meets its limits before it
        has seen enough.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> cell = WorkCell(arm="floating", target="cuboid_1x2", placement="walled", seed=1)
    >>> plan = SpreadViews(cell.segmenter).plan(cell.arm)
    >>> plan.outcome.value, len(plan.views), bool(np.degrees(cell.truth.viewpoint_error()) < 1)
    ('aligned', 5, True)
    """

    segmenter: Segmenter
    estimator: ViewpointEstimator = field(default_factory=ContourFit)
    radius: float = 0.25
    spread: float = np.radians(60)
    until: float = np.radians(0.75)
    fewest: int = 5
    most: int = 10
    following: Literal["spread", "covariance"] = "spread"
    threshold: float = 2.0
    keep_images: bool = False
    wrist_retries: tuple[float, ...] = (np.pi / 2, -np.pi / 2)

    __repr__ = brief

    def __post_init__(self) -> None:
        check_fields(
            self,
            {"radius": "in m", "until": "in rad", "threshold": "in px"},
            segmenter=A_SEGMENTER,
            estimator=(
                lambda part: not lacking(part, ViewpointEstimator),
                "an object with a method estimate(arcs, intrinsics), as ContourFit() and SilhouetteFit() have",
            ),
            spread=(lambda x: 0 < x <= np.pi / 2, "in radians, positive and at most pi/2 (for degrees: np.radians)"),
            fewest=(lambda n: MIN_VIEWS <= n == int(n), f"a whole number, {MIN_VIEWS} or more"),
            most=(lambda n: self.fewest <= n == int(n), "a whole number, not below the fewest"),
            following=(
                self.following == "spread" or (self.following == "covariance" and hasattr(self.estimator, "foreseen")),
                '"spread", or with an estimator that has a method foreseen, as ContourFit() has, "covariance"',
            ),
            wrist_retries=(lambda angles: np.isfinite(angles).all(), "turns of the wrist, in rad"),
        )

    def plan(self, arm: EyeInHandArm) -> Plan:
        """Move the arm to the best view of what it looks at.

        Parameters
        ----------
        arm
            Arm with its camera on the object.
        """
        check_part("an arm", arm, EyeInHandArm, "cell.arm")
        eye = Eye(arm, self.segmenter, keep_images=self.keep_images)
        return with_wrist_turned(eye, self.wrist_retries, lambda: _Run(self, eye), _saw_little)


def _saw_little(run: Attempt, outcome: Outcome) -> bool:
    return saw_nothing(run, outcome) or outcome is Outcome.TOO_FEW_VIEWS


class _Run(Attempt):
    """An attempt by views that are far apart."""

    def __init__(self, planner: SpreadViews, eye: Eye) -> None:
        super().__init__(eye, planner.estimator, planner.radius, planner.threshold)
        self.planner = planner
        self.barred: list[Array] = []  # directions from the object in which the arm cannot go

    def go(self) -> Outcome:
        """Approach, look around, and go to the best view."""
        planner, lens = self.planner, self.eye.intrinsics
        first = center_on_object(self.eye, threshold=_ROUGHLY).view
        if first is None:
            return Outcome.TARGET_NOT_FOUND if self.eye.looks == 1 else Outcome.TARGET_LOST
        self.view = first
        if first.blob.fills((lens.height, lens.width)):
            return Outcome.TOO_LARGE
        center = self._found(first)
        if isinstance(center, Outcome):
            return center
        views = [first]
        enough = planner.most
        while len(views) < enough and (view := self._another(views, center)) is not None:
            views.append(view)
            center = meeting_point(views, lens)
            if len(views) >= planner.fewest:
                found = self._ask(views)
                if found.uncertainty < planner.until:
                    break
                if found.outcome is Outcome.UNEXPLAINED:
                    enough = min(planner.most, planner.fewest + _IN_VAIN)
        if not self.optima or len(self.arcs[0]) < len(views):
            self._ask(views)
        found = self.optima[-1]
        if found.outcome is Outcome.TOO_FEW_VIEWS:
            return found.outcome
        return self.take_up(found) or self.align() or self.verdict()

    def _found(self, view: View) -> Array | Outcome:
        """Where the object is, base frame, m, by a step to some side (A.1); or why the arm cannot tell."""
        arm, lens, pixel = self.eye.arm, self.eye.intrinsics, view.blob.centroid
        for side in _SIDES:
            shift = _STEP * np.array(side)
            motion = arm.move_camera(RigidTransform.from_translation(shift))
            if motion:
                after = self.eye.look()
                if after is None:
                    return Outcome.TARGET_LOST
                depth = estimate_depth(lens, shift, pixel, after.blob.centroid)
                if np.isfinite(depth):
                    ray = lens.rays(after.blob.centroid)
                    return after.base_from_camera.apply(depth * ray / ray[2])
            self.back_to(view)
        return Outcome.NOT_CENTERED if motion else motion.reason

    def near(self, pose: RigidTransform, views: Sequence[View], count: int = 3) -> list[View]:
        """See :meth:`Attempt.near`; the way to far ones may be barred, and the last is where the arm stood just now."""
        return [*super().near(pose, views, count), views[-1]]

    def back_to(self, view: View) -> Motion:
        """See :meth:`Attempt.back_to`; where its joints cannot go straight, the camera perhaps can."""
        arm = self.eye.arm
        motion = arm.move_joints(view.joints)
        return motion or arm.move_camera(arm.camera_pose().inv() * view.base_from_camera)

    def _ask(self, views: list[View]) -> Optimum:
        nowhere = np.full(len(views), np.nan)
        self.arcs = [Arc(None, tuple(views), 0, (Outcome.ENOUGH, Outcome.ENOUGH), nowhere)]
        self.optima = [self.estimate(self.arcs)]
        return self.optima[-1]

    def _another(self, views: list[View], center: Array) -> View | None:
        """One more view, far from those before; None where the arm finds no other."""
        arm, planner = self.eye.arm, self.planner
        seen = np.array([_unit(view.base_from_camera.translation - center) for view in views])
        directions = VirtualSphere(center, 1.0, seen[0]).uniform(_CANDIDATES, planner.spread).translation - center
        # Where the arm finds too few, they may be nearer to each other.
        ranges = (_APART, 0.5 * _APART) if len(views) < planner.fewest else (_APART,)
        for apart in [each for each in ranges for _ in range(_TRIES)]:
            far = _angles(directions, np.array([*seen, *self.barred])).min(axis=1)
            if far.max() < apart:
                continue
            here = arm.camera_pose()
            poses = _looking(directions, center, planner.radius, here)
            goal = self._best(views, far, _angles(directions, _unit(here.translation - center)[None])[:, 0], poses)
            self.eye.expect(None)
            motion, view = arm.move_camera(here.inv() * poses[goal]), None
            stopped = _unit(arm.camera_pose().translation - center)
            if motion or _angles(stopped[None], seen).min() >= apart:
                view = self.eye.look()
                if view is not None and view.clipped:
                    view = center_on_object(self.eye, threshold=_ROUGHLY).view
            if not motion or view is None:
                self.barred.append(directions[goal])
                self.back_to(views[int(_angles(directions[goal][None], seen).argmin())])
            if view is not None:
                return view
        return None

    def _best(self, views: list[View], far: Array, near: Array, poses: RigidTransform) -> int:
        """Number of the pose to look from next, by how far each is from all views, and how near to go to."""
        solid, planner = self.optima[-1].solid if self.optima else None, self.planner
        if planner.following == "covariance" and solid is not None and solid.explains:
            estimator: Any = planner.estimator  # one with a method foreseen
            known = estimator.foreseen(solid, views, self.eye.intrinsics, tuple(poses))
            return int(np.where(far >= _APART, known, np.inf).argmin())
        return int(np.where(far >= _NEARLY * far.max(), near, np.inf).argmin())


def _looking(directions: Array, center: Array, distance: float, here: RigidTransform) -> RigidTransform:
    """Poses in these directions from the center that look at it, turned as little as may be from one."""
    ahead = here.rotation.as_matrix()[:, 2]
    axis, along = np.cross(ahead, -directions), -directions @ ahead
    turn = np.arctan2(np.linalg.norm(axis, axis=1), along)
    vectors = axis * (turn / np.maximum(np.linalg.norm(axis, axis=1), 1e-12))[:, None]
    return RigidTransform.from_components(center + distance * directions, Rotation.from_rotvec(vectors) * here.rotation)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _angles(a: Array, b: Array) -> Array:
    """Between unit vectors (n, 3) and (m, 3): shape (n, m), rad."""
    return np.asarray(np.arccos(np.clip(a @ b.T, -1.0, 1.0)))
