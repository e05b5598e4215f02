"""Planning's vocabulary: what estimators and policies answer, and the finished plan with all that it saw."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from numbers import Integral
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import check_fields, checked, is_right
from gvp_lib.errors import InvalidParameterError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arc import Arc
from gvp_lib.motion.arm import EyeInHandArm, Motion, Outcome
from gvp_lib.motion.sighting import Eye, View
from gvp_lib.picture import Pictured, count
from gvp_lib.planning.grips import Grip
from gvp_lib.planning.solids import FittedSolid

__all__ = [
    "Action",
    "Optimum",
    "Plan",
    "Policy",
    "Quartic",
    "Step",
    "Tilt",
    "ViewpointEstimator",
    "ViewpointPlanner",
    "axes_after",
]

_OF_AN_ESTIMATOR = (
    Outcome.ALIGNED,
    Outcome.ANY_ANGLE,
    Outcome.UNEXPLAINED,
    Outcome.NO_STATIONARY_POINT,
    Outcome.TOO_FEW_VIEWS,
)
MIN_VIEWS = 5
"""A quartic has five coefficients, so fewer views determine none."""


def given_arcs(arcs: Sequence[Arc]) -> list[Arc]:
    """Arcs that an estimator can use, checked; one of them may be given alone."""
    found: list[Arc] = [arcs] if isinstance(arcs, Arc) else list(arcs) if isinstance(arcs, list | tuple) else []
    if not found or not all(isinstance(arc, Arc) and arc.views for arc in found):
        raise InvalidParameterError(
            f"give the arcs of a plan, at least one, and each with views, such as plan.arcs; got {arcs!r}"
        )
    return found


# --- what an estimator answers --------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Quartic(Pictured):
    """Polynomial fitted to the ratios of one arc.

    Attributes
    ----------
    x
        Samples' places on the polynomial's axis, shape (n,): their numbers, or angles in rad.
    polynomial
        Polynomial R(x).
    stationary
        Real stationary points within the samples, ascending, shape (0 … 3,), in units of x.
    chosen
        Stationary point chosen, in units of x; the arc's center where there is none.
    index
        The chosen point as a fractional index into the arc's views.
    """

    _figure = "plot_quartic"

    x: NDArray[np.float64]
    polynomial: Polynomial
    stationary: NDArray[np.float64]
    chosen: float
    index: float

    def __repr__(self) -> str:
        places = ", ".join(f"{place:.3g}" for place in self.stationary) or "none"
        return f"Quartic({count(len(self.x), 'sample')}, stationary at {places}, chosen {self.chosen:.3g})"


@checked
@dataclass(frozen=True, eq=False)
class Optimum(Pictured):
    """Estimator's answer: joint angles to take up, or poses of which the first reachable one is taken.

    Attributes
    ----------
    outcome
        What is known of the viewpoint: ``ALIGNED``, the best one; ``ANY_ANGLE``, all views of the arc look alike;
        ``NO_STATIONARY_POINT`` or ``TOO_FEW_VIEWS``, none was found; ``UNEXPLAINED``, the best of a solid that does not
        explain the views.
    joints
        Joint angles of a place on an arc, shape (n,), rad; or None.
    poses
        Equally good viewpoints, ``base_from_camera``, best first; or none.
    uncertainty
        Standard deviation of the direction of view, rad; NaN where unknown.
    solid
        Solid fitted to the views, if any.
    quartic
        Polynomial fitted to the last arc, if any.
    distance
        Distance of the poses from the object's center, m; NaN for the planner's radius.
    grips
        How two fingers can close about the object, best first; the poses look on the first. Empty where there is no
        such place, or the solid says as much. The camera is then not centered on the object.

    Examples
    --------
    An estimator that always goes back to where each arc began:

    >>> from gvp_lib import ImageMomentPlanner, WorkCell
    >>> from gvp_lib.planning import Optimum
    >>> class Center:
    ...     def estimate(self, arcs, intrinsics):
    ...         return Optimum.at(arcs[-1], arcs[-1].center)
    >>> cell = WorkCell(arm="floating", target="cuboid_1x2", seed=1)
    >>> ImageMomentPlanner(cell.segmenter, Center()).plan(cell.arm).optima[-1]
    Optimum(aligned, joint angles)
    """

    _figure = "plot_optimum"

    outcome: Outcome
    joints: NDArray[np.float64] | None = None
    poses: tuple[RigidTransform, ...] = ()
    uncertainty: float = float("nan")
    solid: FittedSolid | None = None
    quartic: Quartic | None = None
    distance: float = float("nan")
    grips: tuple[Grip, ...] = ()

    def __post_init__(self) -> None:
        if self.outcome not in _OF_AN_ESTIMATOR:
            known = ", ".join(f"Outcome.{outcome.name}" for outcome in _OF_AN_ESTIMATOR)
            raise InvalidParameterError(f"the outcome of an Optimum is one of {known}; got {self.outcome!r}")
        object.__setattr__(self, "outcome", Outcome(self.outcome))
        fine = "joint angles, finite, shape (n,), rad, or None"
        check_fields(self, {}, joints=(lambda q: q is None or (np.ndim(q) == 1 and np.isfinite(q).all()), fine))

    @classmethod
    def at(cls, arc: Arc, index: int, outcome: Outcome = Outcome.ALIGNED, *, quartic: Quartic | None = None) -> Optimum:
        """Place of one of an arc's views.

        Parameters
        ----------
        arc
            Arc with at least one view.
        index
            Number of the view, from 0.
        outcome, quartic
            As in the class.
        """
        if not isinstance(index, Integral) or isinstance(index, bool):
            raise InvalidParameterError(
                f"Optimum.at takes the number of a view, a whole number; got {index}. For an angle in rad the nearest "
                "view is int(np.abs(arc.angles - angle).argmin()); Optimum.between(arc, 2.5) lies between two views"
            )
        return cls.between(arc, index, outcome, quartic=quartic)

    @classmethod
    def between(
        cls, arc: Arc, place: float, outcome: Outcome = Outcome.ALIGNED, *, quartic: Quartic | None = None
    ) -> Optimum:
        """Place between two views of an arc, by interpolated joint angles.

        Parameters
        ----------
        arc
            Arc with at least one view.
        place
            Fractional number of a view: 2.5 is halfway from view 2 to view 3.
        outcome, quartic
            As in the class.
        """
        if not isinstance(arc, Arc):
            raise InvalidParameterError(f"an Optimum is a place on one arc, such as arcs[-1]; got {arc!r}")
        last = len(arc) - 1
        if not is_right(lambda x: 0 <= x <= last, place):
            known = f", numbered 0 to {last}; to stay where it began: Optimum.at(arc, arc.center)" if last >= 0 else ""
            raise InvalidParameterError(f"there is no place {place} on an arc of {len(arc)} views{known}")
        low = int(place)
        share = float(place - low)
        joints = (1 - share) * arc.views[low].joints + share * arc.views[min(low + 1, last)].joints
        return cls(outcome, joints=joints, quartic=quartic)

    def __repr__(self) -> str:
        where = "joint angles" if self.joints is not None else count(len(self.poses), "pose")
        found = self.solid or self.quartic
        return f"Optimum({self.outcome}, {where}{sd_text(self.uncertainty)}{f', {found}' if found else ''})"


@runtime_checkable
class ViewpointEstimator(Protocol):
    """Finder of the best viewpoint in the arcs seen so far. Ten lines are enough for one of your own."""

    def estimate(self, arcs: Sequence[Arc], intrinsics: CameraIntrinsics) -> Optimum:
        """Find the best viewpoint.

        Parameters
        ----------
        arcs
            Arcs traversed so far, at least one, none of them empty; the arm stands in the last.
        intrinsics
            Camera's lens, as the arm states it.
        """
        ...


@runtime_checkable
class ViewpointPlanner(Protocol):
    """Planner of a grasp viewpoint: what :func:`pick_up` and :func:`gvp_lib.evaluation.compare` call."""

    def plan(self, arm: EyeInHandArm) -> Plan:
        """Move the arm's camera to a viewpoint from which to grasp.

        Parameters
        ----------
        arm
            Arm with its camera on the object.
        """
        ...


# --- what a policy answers ------------------------------------------------------------------------------------------


class Action(IntEnum):
    """Step of the learned planner over the virtual sphere, in a direction of the image, or none.

    UP moves the camera along its own -y, however it is rolled.

    Examples
    --------
    >>> Action.DOWN.direction
    (0, 1)
    >>> Action(4).name
    'NO_OP'
    """

    UP = 0
    LEFT = 1
    DOWN = 2
    RIGHT = 3
    NO_OP = 4

    @property
    def direction(self) -> tuple[int, int]:
        """Direction in which the camera moves in the image, (u, v), each of -1, 0, 1."""
        return ((0, -1), (-1, 0), (0, 1), (1, 0), (0, 0))[self]

    def step(self, angle: float, radius: float) -> RigidTransform:
        """Motion over a sphere whose center stays in place in the picture, as ``camera_from_target``.

        Parameters
        ----------
        angle
            Angle of the motion seen from the sphere's center, rad.
        radius
            Radius of the sphere, m.
        """
        return _over_sphere(self.direction, angle, radius)


@checked(own=True)
def axes_after(angle: float) -> NDArray[np.float64]:
    """Optical axis after each of the five actions, in the camera's present frame, shape (5, 3).

    Parameters
    ----------
    angle
        Angle of a step over the sphere, rad.

    Examples
    --------
    >>> axes_after(np.radians(30)).shape
    (5, 3)
    """
    if not is_right(lambda x: 0 <= x <= np.pi, angle):
        raise InvalidParameterError(f"the angle of a step is in radians, from 0 to pi; got {angle!r}")
    moves = np.array([action.direction for action in Action], float)
    still = 1.0 - np.abs(moves).sum(axis=1)
    return np.column_stack([-np.sin(angle) * moves, np.cos(angle) * (1 - still) + still])


@checked
@dataclass(frozen=True, slots=True)
class Tilt:
    """Output of a regression policy: how far, and which way, the camera has yet to move over the sphere.

    A motion by the angle ``hypot(u, v)`` in the image direction ``atan2(v, u)``, as ``Label.angle`` and
    ``Label.direction`` count them (:mod:`gvp_lib.learning.labels`), makes the camera look along the object's normal.

    Parameters
    ----------
    u, v
        Components of the angle along the image's u and v, rad.
    sigma
        Standard deviation of each component, rad, positive; ``inf`` where the policy cannot tell.

    Examples
    --------
    >>> tilt = Tilt(0.0, np.radians(20), sigma=np.radians(2))
    >>> round(float(np.degrees(tilt.angle)), 6)
    20.0
    >>> np.allclose(tilt.step(0.5, most=np.radians(5)).as_matrix(), Action.DOWN.step(np.radians(5), 0.5).as_matrix())
    True
    """

    u: float
    v: float
    sigma: float

    def __post_init__(self) -> None:
        for name in ("u", "v", "sigma"):  # as a network gives them they may be scalars of any library
            object.__setattr__(self, name, float(getattr(self, name)))
        # The parts of an angle of pi may come to the last bits more than pi.
        if not (np.hypot(self.u, self.v) <= np.pi * (1 + 1e-12) and self.sigma > 0):
            raise InvalidParameterError(
                "a tilt is two parts of an angle in rad, at most pi together, and their standard deviation in rad, "
                f"positive, or inf where nothing is known; got u={self.u}, v={self.v}, sigma={self.sigma}"
            )

    @classmethod
    def toward(cls, normal: ArrayLike, sigma: float) -> Tilt:
        """Tilt after which the camera looks along the reversed normal.

        Parameters
        ----------
        normal
            Object's outward normal in the camera's present frame, shape (3,).
        sigma
            Standard deviation of each component, rad.
        """
        normal = np.asarray(normal, float)
        if normal.shape != (3,) or not 0 < np.abs(normal).max() < np.inf:
            raise InvalidParameterError(f"a normal is a finite vector of shape (3,), not of zeros; got {normal}")
        x, y, z = normal
        angle, direction = np.arctan2(np.hypot(x, y), -z), np.arctan2(y, x)
        return cls(float(angle * np.cos(direction)), float(angle * np.sin(direction)), sigma)

    @property
    def angle(self) -> float:
        """Angle to move by, rad, in [0, pi]."""
        return min(float(np.hypot(self.u, self.v)), np.pi)

    @property
    def direction(self) -> float:
        """Direction to move in the image, rad, from +u toward +v, in (-pi, pi]."""
        return float(np.arctan2(self.v, self.u))

    @property
    def normal(self) -> NDArray[np.float64]:
        """Object's normal according to this tilt: a unit vector in the camera's present frame, shape (3,)."""
        across = np.sin(self.angle)
        return np.array([across * np.cos(self.direction), across * np.sin(self.direction), -np.cos(self.angle)])

    def step(self, radius: float, most: float = np.pi) -> RigidTransform:
        """Motion over the sphere, as ``camera_from_target``.

        Parameters
        ----------
        radius
            Radius of the sphere, m.
        most
            Largest angle of the motion, rad.
        """
        return _over_sphere((np.cos(self.direction), np.sin(self.direction)), min(self.angle, most), radius)


def _over_sphere(direction: tuple[float, float], angle: float, radius: float) -> RigidTransform:
    """Motion by an angle about the point ``radius`` m ahead, toward a unit direction (u, v) of the image or (0, 0)."""
    if not (is_right(lambda x: 0 <= x <= np.pi, angle) and is_right(lambda x: 0 < x < np.inf, radius)):
        raise InvalidParameterError(
            f"a step is an angle in rad, at most pi, on a sphere of positive radius in m; got {angle}, {radius}"
        )
    du, dv = direction
    rotation = Rotation.from_rotvec(angle * np.array([dv, -du, 0.0]))
    center = np.array([0.0, 0.0, radius])
    return RigidTransform.from_components(center - rotation.apply(center), rotation)


Policy = Callable[[NDArray[np.uint8]], Action | Tilt]
"""Answers a picture, RGB uint8 (H, W, 3), with what to do: given all of it, to be cropped as the policy was trained."""


# --- the plan -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Step:
    """One iteration of the learned planner's closed loop: center, look, ask the policy, move.

    Attributes
    ----------
    view
        View shown to the policy, the object in the middle; None where the object was not in sight.
    said
        Policy's answer; None where the object could not be centered.
    motion
        Motion over the sphere that followed; None where the camera stayed.
    left
        Remaining tilt to the normal and its sigma, by all looks together, as seen from this view; None where nothing
        is known.
    outcome
        How the plan ends with this step; None where it goes on.
    barred
        Motions to viewpoints of a survey that were tried first and stopped early.
    """

    view: View | None
    said: Action | Tilt | None = None
    motion: Motion | None = None
    left: Tilt | None = None
    outcome: Outcome | None = None
    barred: tuple[Motion, ...] = ()

    def __repr__(self) -> str:
        said = self.said
        answer = (
            f"{np.degrees(said.angle):.0f} deg" if isinstance(said, Tilt) else "nothing" if said is None else said.name
        )
        moved = "stayed" if self.motion is None else self.motion.reason
        return f"Step({answer}, {moved}{f', {self.outcome}' if self.outcome else ''})"


_LEANS = np.radians(5)  # from the wanted direction, which is worth a word


@dataclass(frozen=True, eq=False)
class Plan(Pictured):
    """Finished plan: how it ended, what was seen on the way, and what was made of it.

    Attributes
    ----------
    outcome
        How it ended.
    arcs
        Arcs traversed, in order.
    optima
        Estimator's answer after each.
    view
        View from where the camera now stands; None where the object was not in sight.
    frames
        Pictures taken, those of earlier attempts included.
    steps
        Steps of the learned planner, in order; it has no arcs.
    attempts
        How the attempts ended that came before this one.
    """

    _figure = "plot_plan"

    outcome: Outcome
    arcs: tuple[Arc, ...] = ()
    optima: tuple[Optimum, ...] = ()
    view: View | None = None
    frames: int = 0
    steps: tuple[Step, ...] = ()
    attempts: tuple[Outcome, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "outcome", Outcome(self.outcome))  # whoever writes a planner may give its text

    @classmethod
    @checked
    def standing(cls, eye: Eye, outcome: Outcome = Outcome.REACHED) -> Plan:
        """Conclude a plan without arcs by one more look.

        Parameters
        ----------
        eye
            Eye of the arm, whose camera stands where the planner has left it.
        outcome
            How the last motion or centering ended; ``REACHED`` becomes ``ALIGNED``, or ``TARGET_LOST`` where the look
            does not find the object.
        """
        eye.expect(None)
        view = eye.look()
        if outcome is Outcome.REACHED:
            outcome = Outcome.TARGET_LOST if view is None else Outcome.ALIGNED
        return cls(outcome, view=view, frames=eye.looks)

    @property
    def views(self) -> tuple[View, ...]:
        """Every view of every arc, or of every step: the trace."""
        of_arcs = (view for arc in self.arcs for view in arc.views)
        return (*of_arcs, *(step.view for step in self.steps if step.view is not None))

    @property
    def joints(self) -> NDArray[np.float64] | None:
        """Joint angles at the last view, shape (n,), rad; None where there is no view."""
        return None if self.view is None else self.view.joints

    @property
    def solid(self) -> FittedSolid | None:
        """Last solid that an estimator fitted to the views; None without one."""
        return next((optimum.solid for optimum in reversed(self.optima) if optimum.solid is not None), None)

    @property
    def grips(self) -> tuple[Grip, ...]:
        """How two fingers can close about the object, best first, if the camera looks on the first; else none."""
        return self.optima[-1].grips if self.optima and self.outcome.arrived else ()

    @property
    def uncertainty(self) -> float:
        """Standard deviation of the final direction of view, rad, as far as the planner knows; else NaN."""
        known = [optimum.uncertainty for optimum in self.optima]
        known += [step.left.sigma for step in self.steps if step.left is not None]
        return known[-1] if known and self.outcome.arrived else float("nan")

    @property
    def lean(self) -> float:
        """Angle between the line of sight and what was wanted, rad, as the arm believes; NaN where nothing was.

        More than a degree or two where the arm could not reach that direction: see ``lean`` of an estimator.
        """
        solid, grips = self.solid, self.grips
        if self.view is None or (solid is None and not grips):
            return float("nan")
        wanted = grips[0].look if grips else solid.normal  # type: ignore[union-attr]
        return float(np.arccos(np.clip(-wanted @ self.view.line_of_sight, -1.0, 1.0)))

    def __repr__(self) -> str:
        trace = count(len(self.steps), "step")
        if not self.steps:
            trace = f"{count(len(self.arcs), 'arc')}, {count(len(self.views), 'view')}"
        before = f" after {', '.join(self.attempts)}" if self.attempts else ""
        solid = f", {self.solid}" if self.solid is not None else ""
        leans = f", leans {np.degrees(self.lean):.0f} deg" if self.outcome.arrived and self.lean > _LEANS else ""
        pictures = count(self.frames, "picture")
        return f"Plan({self.outcome}{before}, {trace}, {pictures}{sd_text(self.uncertainty)}{leans}{solid})"


def sd_text(uncertainty: float) -> str:
    """Standard deviation as it stands in a repr, after a comma; empty where unknown."""
    return f", sd {np.degrees(uncertainty):.2g} deg" if np.isfinite(uncertainty) else ""
