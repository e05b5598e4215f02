"""The learned viewpoint planner: look, ask a policy, step over the sphere, and again. Thesis 2.4, 2.4.5; errata 16 to
18."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from numbers import Integral

import numpy as np
from numpy.typing import NDArray

from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arm import EyeInHandArm
from gvp_lib.motion.centering import Centering, center_on_object
from gvp_lib.motion.sighting import Eye, View
from gvp_lib.perception.moments import Blob
from gvp_lib.perception.segmentation import Segmenter
from gvp_lib.planning.cnn import Action, Tilt
from gvp_lib.planning.plan import Plan, PlanOutcome, Step

__all__ = ["CnnPlanner", "Policy"]

Policy = Callable[[NDArray[np.uint8]], Action | Tilt]
"""Says what to do about a picture, RGB uint8 (H, W, 3): the whole of it, to be cropped as the policy was trained."""


@dataclass(frozen=True)
class CnnPlanner:
    """Moves the camera over the virtual sphere as a policy says that sees one picture at a time.

    Each step centers the object (Algorithm 1), shows the policy the picture, and moves as it says. A policy is a
    network (:mod:`gvp_lib.learning`) or anything that is called alike; the planner sees the arm only as an
    :class:`EyeInHandArm`, and the camera must stand at the radius already: the distance is never measured.

    A policy that says an :class:`Action` is the thesis's: the plan ends at its NO_OP. At best it ends within 0.71
    steps of the normal, 0.38 on average, which is all that four directions allow (errata 17).

    A policy that says a :class:`Tilt` is ours. The last ``memory`` looks are fused: each becomes a normal in the
    arm's base frame, weighted by its precision ``1 / sigma**2``. The camera moves toward the fused normal, and the plan
    ends by its own uncertainty: once no more is left than the fused sigma, it moves by that and stops.

    Attributes
    ----------
    segmenter
        RGB uint8 (H, W, 3) to mask bool (H, W); for centering alone.
    policy
        RGB uint8 (H, W, 3) to an Action or a Tilt.
    radius
        Of the virtual sphere on which the camera stands, m.
    step
        By how much an Action moves over the sphere, rad: what the policy was trained with.
    max_steps
        How often the policy is asked at most; then a plan is out of steps.
    threshold
        Of every centering, px.
    stop_at_reversal
        Whether a plan ends, as at NO_OP, where an action would undo the one before: the normal then lies between two
        viewpoints a step apart. The thesis has no such rule, and a policy may swing between the two to the end; off by
        default.
    memory
        Looks that are fused. The object is taken to stand still among them: for one that moves, 1, by which each look
        replaces the one before.
    correlation
        Between the errors of any two looks, in [0, 1], for the fused sigma. One network errs alike in views that are
        alike, so n looks do not tell sqrt(n) times as much as one; how much more is assumed, not measured: at 0.5 many
        equal looks take the sigma down to 0.71 of one look's, never below. At 0 they count as independent, at 1 as one.
    min_looks
        Looks that must be fused before the uncertainty may end a plan; all of ``memory`` where that is fewer.
    max_move
        The farthest that one step moves toward the fused normal, rad.
    keep_images
        Whether the views of the trace keep their pictures (0.9 MB each).

    Examples
    --------
    >>> from gvp_lib import VirtualSphere, WorkCell
    >>> cell = WorkCell(arm="floating", target="cuboid_1x2", seed=1)
    >>> center = cell.truth.world_from_object.translation
    >>> cell.place_camera(VirtualSphere(center, 0.5).viewpoint(np.radians(30), 0.0))
    >>> said = iter([Action.UP, Action.UP, Action.NO_OP])
    >>> plan = CnnPlanner(cell.segmenter, policy=lambda rgb: next(said)).plan(cell.arm)
    >>> plan.outcome.value, len(plan.steps), round(float(np.degrees(cell.truth.viewpoint_error())))
    ('aligned', 3, 20)
    """

    segmenter: Segmenter
    policy: Policy
    radius: float = 0.5
    step: float = np.radians(5)
    max_steps: int = 50
    threshold: float = 2.0
    stop_at_reversal: bool = False
    memory: int = 5
    correlation: float = 0.5
    min_looks: int = 3
    max_move: float = np.radians(15)
    keep_images: bool = False

    def __post_init__(self) -> None:
        if not callable(self.policy):
            raise InvalidParameterError(
                "a policy is called with an RGB image and returns an Action or a Tilt, such as lambda rgb: "
                f"Action.NO_OP; got {self.policy!r}"
            )
        for name, unit in (("radius", "m"), ("threshold", "px")):
            value = getattr(self, name)
            if not 0 < value < np.inf:
                raise InvalidParameterError(f"CnnPlanner.{name} is positive and finite, in {unit}; got {value}")
        for name in ("step", "max_move"):
            value = getattr(self, name)
            if not 0 < value <= np.pi / 2:
                raise InvalidParameterError(
                    f"CnnPlanner.{name} is in radians, in (0, pi/2]; got {value}. For degrees: np.radians(...)"
                )
        for name in ("max_steps", "memory", "min_looks"):
            _check_count(f"CnnPlanner.{name}", getattr(self, name))
        if not 0 <= self.correlation <= 1:
            raise InvalidParameterError(f"CnnPlanner.correlation is between 0 and 1; got {self.correlation}")

    def plan(self, arm: EyeInHandArm) -> Plan:
        """Move the arm until the policy is content or out of steps, and tell how that went."""
        loop, steps = _Loop(self, arm), []
        for step in islice(loop, self.max_steps):
            steps.append(step)
            if step.outcome is not None:
                break
        return loop.finished(steps)

    def follow(self, arm: EyeInHandArm, looks: int) -> Plan:
        """Take so many steps whatever the policy says, for an object that moves; the last says how that ended."""
        _check_count("looks", looks)
        loop = _Loop(self, arm)
        return loop.finished(list(islice(loop, looks)))

    def steps(self, arm: EyeInHandArm) -> Iterator[Step]:
        """Step after step without end, for a caller who decides when it is enough and what happens in between.

        Nothing ends it: after NO_OP the camera stays and looks again, and so it does where the object is lost or a
        motion was barred. ``Step.outcome`` says where :meth:`plan` would have stopped.
        """
        return _Loop(self, arm)


class _Loop(Iterator[Step]):
    """The closed loop on one arm, and what it remembers from step to step."""

    def __init__(self, planner: CnnPlanner, arm: EyeInHandArm) -> None:
        self.planner, self.arm = planner, arm
        self.eye = Eye(arm, planner.segmenter, keep_images=planner.keep_images, on_look=self._keep)
        self.seen = False  # whether the object ever was in sight
        self.made = Action.NO_OP  # the action that the last step carried out
        self.normals: deque[tuple[NDArray[np.float64], float]] = deque(maxlen=planner.memory)  # base frame; sigma, rad

    def _keep(self, rgb: NDArray[np.uint8], blob: Blob | None) -> None:
        self.rgb = rgb

    def __next__(self) -> Step:
        centered = self._center()
        view, trouble = centered.view, self._trouble(centered)
        if view is None or trouble is not None:
            self.made = Action.NO_OP
            return Step(view, outcome=trouble)
        said = self.planner.policy(self.rgb)
        if isinstance(said, Action):
            return self._act(view, said)
        if isinstance(said, Tilt):
            return self._turn(view, said)
        numbered = isinstance(said, Integral) and said in list(Action)
        hint = f"Action({said})" if numbered else "Action.NO_OP or Tilt(u, v, sigma)"
        raise InvalidParameterError(f"a policy returns an Action or a Tilt; got {said!r}, where {hint} would do")

    def finished(self, steps: list[Step]) -> Plan:
        """The plan that these steps make, with a view from where the camera now stands."""
        last = steps[-1]
        view, outcome = last.view, last.outcome or PlanOutcome.OUT_OF_STEPS
        if last.motion:
            centered = self._center()
            view, outcome = centered.view, self._trouble(centered) or outcome
        elif last.motion is not None:
            view = self.eye.look()
        return Plan(outcome, (), (), view, self.eye.looks, tuple(steps))

    def _center(self) -> Centering:
        centered = center_on_object(self.eye, threshold=self.planner.threshold)
        self.seen |= len(centered.offsets) > 0
        return centered

    def _trouble(self, centered: Centering) -> PlanOutcome | None:
        if not centered.motion:
            return PlanOutcome(centered.motion.reason.value)
        if centered.view is None:
            return PlanOutcome.TARGET_LOST if self.seen else PlanOutcome.TARGET_NOT_FOUND
        return None if centered else PlanOutcome.NOT_CENTERED

    def _act(self, view: View, action: Action) -> Step:
        """The thesis's step."""
        reversal = self.made is not Action.NO_OP and action == (self.made + 2) % 4
        if action is Action.NO_OP or (reversal and self.planner.stop_at_reversal):
            self.made = Action.NO_OP
            return Step(view, action, outcome=PlanOutcome.ALIGNED)
        motion = self.arm.move_camera(action.step(self.planner.step, self.planner.radius))
        self.made = action if motion else Action.NO_OP
        return Step(view, action, motion, outcome=None if motion else PlanOutcome(motion.reason.value))

    def _turn(self, view: View, said: Tilt) -> Step:
        """Ours: toward the normal by all that is remembered."""
        planner, base_from_camera = self.planner, view.base_from_camera.rotation
        self.normals.append((base_from_camera.apply(said.normal), said.sigma))
        known = [(normal, sigma) for normal, sigma in self.normals if np.isfinite(sigma)]
        if not known:
            return Step(view, said)
        normal, sigma = _fused(known, planner.correlation)
        left = Tilt.toward(base_from_camera.inv().apply(normal), sigma)
        settled = left.angle < left.sigma and len(known) >= min(planner.min_looks, planner.memory)
        motion = self.arm.move_camera(left.step(planner.radius, planner.max_move))
        going = PlanOutcome.ALIGNED if settled else None
        return Step(view, said, motion, left, going if motion else PlanOutcome(motion.reason.value))


def _fused(known: list[tuple[NDArray[np.float64], float]], correlation: float) -> tuple[NDArray[np.float64], float]:
    """The precision-weighted mean of n normals, shape (3,), not of unit length, and its standard deviation, rad.

    The variance of a weighted mean is the sum of ``w_i w_j c_ij s_i s_j``, with ``c_ij`` the correlation between two
    looks' errors and 1 on the diagonal.
    """
    normals = np.array([normal for normal, _ in known])  # (n, 3)
    sigmas = np.array([sigma for _, sigma in known])  # (n,)
    weights = (sigmas.min() / sigmas) ** 2
    weights /= weights.sum()
    parts = weights * sigmas
    variance = (1 - correlation) * (parts @ parts) + correlation * parts.sum() ** 2
    return weights @ normals, float(np.sqrt(variance))


def _check_count(name: str, value: int) -> None:
    if not isinstance(value, Integral) or isinstance(value, bool) or value < 1:
        raise InvalidParameterError(f"{name} is a whole number, at least 1; got {value!r}")
