"""The learned viewpoint planner: look, ask a policy, step over the sphere, and again. Thesis 2.4, 2.4.5; errata 16-18.

A policy answers with one of the thesis's five actions, or with a tilt; several tilts of an object that stands still are
put together to one normal, which is beyond the thesis.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from numbers import Integral

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gvp_lib.checks import A_SEGMENTER, check_fields, check_part, checked, takes_a_picture
from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arm import EyeInHandArm, Motion, Outcome
from gvp_lib.motion.primitives import toward_pixel
from gvp_lib.motion.sighting import Adjustment, Eye, View, center_on_object
from gvp_lib.perception.blobs import Blob
from gvp_lib.perception.segmentation import Segmenter
from gvp_lib.picture import brief
from gvp_lib.planning.plan import Action, Plan, Policy, Step, Tilt

__all__ = ["CnnPlanner", "fused"]

_PULL_SD = 0.3  # of the pull before any look: 0.05 is usual, and 0.6 in light that a network has not learned from
_MOST_PULL = 0.9  # at 1 a policy says no tilt wherever it looks from, and nothing is to be had from it


@checked(own=True)
@dataclass(frozen=True)
class CnnPlanner:
    """Closed-loop viewpoint planner: one policy call per picture.

    Each step centers the object (Algorithm 1), shows the policy the picture, and moves as it answers. A policy is a
    network (:mod:`gvp_lib.learning`) or any other callable. The camera must stand at the radius already: the distance
    is never measured.

    A policy that answers with an :class:`Action` is the thesis's: the plan ends at its NO_OP, at best within 0.71 steps
    of the normal, 0.38 on average, which is all that four directions allow (errata 17).

    A policy that answers with a :class:`Tilt` is ours. Each look gives a normal in the arm's base frame, and a plan
    fuses all of them; the object must stand still meanwhile. A network that is unsure underestimates the tilt: it pulls
    the normal toward the axis that it looks along, and looks from all around show by how much. Hence a survey: after
    the first look the camera circles the normal as known so far, looks from each viewpoint within reach, goes to the
    fused normal, and stops. Without a survey, or where none of its viewpoints was usable, the camera moves toward the
    fused normal until no more is left than the fused sigma.

    Parameters
    ----------
    segmenter
        RGB uint8 (H, W, 3) to mask bool (H, W), used for centering alone.
    policy
        RGB uint8 (H, W, 3) to an Action or a Tilt.
    radius
        Radius of the virtual sphere on which the camera stands, m.
    step
        Angle of an Action over the sphere, rad, as in the policy's training.
    max_steps
        Largest number of policy calls; then a plan is out of steps.
    threshold
        Largest offset after a centering, px.
    off_center
        Largest offset of an object that the arm cannot center, px, in u and in v: at the end of its reach an arm may be
        unable to turn where it stands, and yet free to move on.
    stop_at_reversal
        Whether a plan ends, as at NO_OP, where an action would undo the one before. In the thesis a policy may swing
        between two viewpoints to the end.
    survey
        Number of the survey's viewpoints, evenly spaced about the normal from the side where the camera is: at least 3,
        or 0 for none. Only :meth:`plan` surveys.
    survey_tilt
        Tilt of the survey's viewpoints from the normal, rad.
    until
        Fused sigma below which a plan goes to the normal and ends, whatever remains of the survey, rad.
    max_move
        Largest angle of one step, rad. Where a survey's viewpoint is farther off, the camera looks from that far.
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
    off_center: float = 24.0
    stop_at_reversal: bool = False
    survey: int = 6
    survey_tilt: float = np.radians(14)
    until: float = 0.0
    max_move: float = np.radians(30)
    keep_images: bool = False

    __repr__ = brief

    def __post_init__(self) -> None:
        angle = (lambda x: 0 < x <= np.pi / 2, "in radians, in (0, pi/2] (for degrees: np.radians)")
        check_fields(
            self,
            {"radius": "in m", "threshold": "in px"},
            segmenter=A_SEGMENTER,
            policy=(
                takes_a_picture,  # called as one is
                "called with an RGB image and returns an Action or a Tilt, as a NetworkPolicy does",
            ),
            off_center=(lambda x: self.threshold <= x < np.inf, "at least the threshold, in px"),
            max_steps=(_is_count(self.max_steps, 1), "a whole number, at least 1"),
            survey=(
                _is_count(self.survey, 0) and self.survey not in (1, 2),
                "a whole number, at least 3, or 0 for none",
            ),
            until=(
                lambda x: 0 <= x <= np.pi / 2,
                "a standard deviation in radians, 0 for never (for degrees: np.radians)",
            ),
            **dict.fromkeys(("step", "survey_tilt", "max_move"), angle),
        )

    def plan(self, arm: EyeInHandArm) -> Plan:
        """Move the arm until the policy is content or out of steps.

        Parameters
        ----------
        arm
            Arm with its camera on the object.
        """
        loop, steps = _Loop(self, arm, still=True), []
        for step in islice(loop, self.max_steps):
            steps.append(step)
            if step.outcome is not None:
                break
        return loop.finished(steps)

    def steps(self, arm: EyeInHandArm) -> Iterator[Step]:
        """Follow the policy without end, for a caller who decides when to stop and what happens in between.

        The object may move: each tilt replaces the one before. After NO_OP, a lost object, or a motion that stopped
        early, the camera stays and looks again. Once lost, an object is found wherever it comes back; of several, the
        one nearest the middle of the picture. ``Step.outcome`` says where :meth:`plan` would have stopped without a
        survey.

        Parameters
        ----------
        arm
            Arm with its camera on the object.
        """
        return _Loop(self, arm, still=False)


def _is_count(value: object, least: int) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool) and int(value) >= least


class _Loop(Iterator[Step]):
    """The closed loop on one arm, and what it remembers from step to step."""

    def __init__(self, planner: CnnPlanner, arm: EyeInHandArm, *, still: bool) -> None:
        check_part("an arm", arm, EyeInHandArm, "cell.arm")
        self.planner, self.arm, self.still = planner, arm, still
        self.eye = Eye(arm, planner.segmenter, keep_images=planner.keep_images, on_look=self._keep)
        self.seen = False  # whether the object ever was in sight
        self.made = Action.NO_OP  # the action that the last step carried out
        # Of an object that stands still every look, else the last: normal said, own axis reversed, base frame; sigma.
        self.looks: deque[tuple[NDArray[np.float64], NDArray[np.float64], float]] = deque(maxlen=None if still else 1)
        survey = planner.survey if still else 0
        self.ring = deque(2 * np.pi * k / survey for k in range(survey))  # rad, about the normal: yet to be looked from
        self.side = np.zeros(3)  # where the ring begins, base frame
        self.on_ring = self.surveyed = False  # whether the camera is on it now; whether it has looked from it

    def _keep(self, rgb: NDArray[np.uint8], blob: Blob | None) -> None:
        self.rgb = rgb

    def __next__(self) -> Step:
        centered, trouble = self._center()
        view = centered.view
        if view is None and not self.still:
            self.eye.expect(None)  # what moves comes back anywhere, at any distance
        if view is None or trouble is not None:
            self.made = Action.NO_OP
            return self._go(view, None) if self.on_ring else Step(view, outcome=trouble)
        said = self.planner.policy(self.rgb)
        if isinstance(said, Action):
            return self._act(view, said)
        if isinstance(said, Tilt):
            return self._turn(view, said, bool(centered))
        numbered = isinstance(said, Integral) and said in list(Action)
        hint = f"Action({said})" if numbered else "Action.NO_OP or Tilt(u, v, sigma)"
        raise InvalidParameterError(f"a policy returns an Action or a Tilt; got {said!r}, where {hint} would do")

    def finished(self, steps: list[Step]) -> Plan:
        """The plan that these steps make, with a view from where the camera now stands."""
        last = steps[-1]
        view, outcome = last.view, last.outcome or Outcome.OUT_OF_STEPS
        if last.motion:
            # By shifting, the direction stays what it is.
            centered, trouble = self._center(None if last.left is None else self.planner.radius)
            view, outcome = centered.view, trouble or outcome
        elif last.motion is not None:
            view = self.eye.look()
        return Plan(outcome, (), (), view, self.eye.looks, tuple(steps))

    def _center(self, depth: float | None = None) -> tuple[Adjustment, Outcome | None]:
        """Center by turning, or at a depth by shifting; what went wrong, other than an offset that may be left."""
        centered = center_on_object(self.eye, depth=depth, threshold=self.planner.threshold)
        self.seen |= len(centered.errors) > 0
        if centered.view is not None and np.abs(centered.errors[-1]).max() <= self.planner.off_center:
            return centered, None
        if centered.outcome is Outcome.TARGET_LOST and not self.seen:
            return centered, Outcome.TARGET_NOT_FOUND
        return centered, centered.outcome

    def _act(self, view: View, action: Action) -> Step:
        """The thesis's step."""
        reversal = self.made is not Action.NO_OP and action == (self.made + 2) % 4
        if action is Action.NO_OP or (reversal and self.planner.stop_at_reversal):
            self.made = Action.NO_OP
            return Step(view, action, outcome=Outcome.ALIGNED)
        motion = self.arm.move_camera(action.step(self.planner.step, self.planner.radius))
        self.made = action if motion else Action.NO_OP
        return Step(view, action, motion, outcome=None if motion else motion.reason)

    def _turn(self, view: View, said: Tilt, centered: bool) -> Step:
        """Ours: remember what the look says, and go on."""
        if np.isfinite(said.sigma):
            rotation = view.base_from_camera.rotation
            if not centered:  # what a policy says then is of the object in the middle, where a turn would bring it
                rotation *= toward_pixel(self.arm.intrinsics, view.blob.centroid)
            self.looks.append((rotation.apply(said.normal), rotation.apply([0.0, 0.0, -1.0]), said.sigma))
            self.surveyed |= self.on_ring
        return self._go(view, said) if self.looks else Step(view, said)

    def _go(self, view: View | None, said: Tilt | None) -> Step:
        """To the next viewpoint of the survey that can be had, or to the normal."""
        planner = self.planner
        normal, sigma = fused(*map(np.array, zip(*self.looks, strict=True)))
        left, self.on_ring = self._toward(normal, sigma), False
        barred: list[Motion] = []
        enough = sigma < planner.until
        while self.ring and not enough:
            viewpoint = self._toward(self._on_ring(normal, self.ring.popleft()), sigma)
            motion = self.arm.move_camera(viewpoint.step(planner.radius, planner.max_move))
            if motion:
                self.on_ring = True
                return Step(view, said, motion, left, barred=tuple(barred))
            barred.append(motion)
        rest = self._toward(normal, sigma)  # a motion that was barred may have led elsewhere
        motion = self.arm.move_camera(rest.step(planner.radius, planner.max_move))
        settled = rest.angle <= planner.max_move and (enough or self.surveyed or rest.angle < sigma)
        going = Outcome.ALIGNED if settled else None
        outcome = going if motion else motion.reason
        return Step(view, said, motion, left, outcome, tuple(barred))

    def _toward(self, direction: NDArray[np.float64], sigma: float) -> Tilt:
        """From where the camera stands to where it looks along the reversed direction, base frame."""
        return Tilt.toward(self.arm.camera_pose().rotation.inv().apply(direction), sigma)

    def _on_ring(self, normal: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
        """From the object to the survey's viewpoint at an angle, rad, about the normal: a unit vector, base frame."""
        normal = normal / np.linalg.norm(normal)
        if not self.side.any():
            x, _, z = self.arm.camera_pose().rotation.as_matrix().T
            self.side = -z if np.linalg.norm(np.cross(z, normal)) > 1e-6 else x
        side = self.side - (self.side @ normal) * normal
        side = Rotation.from_rotvec(angle * normal).apply(side / np.linalg.norm(side))
        tilt = self.planner.survey_tilt
        return np.cos(tilt) * normal + np.sin(tilt) * side


@checked(own=True)
def fused(
    normals: NDArray[np.float64], axes: NDArray[np.float64], sigmas: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Fuse the normals of n looks: their normal, shape (3,), not of unit length, and its standard deviation, rad.

    A look from ``axis`` says ``normal + pull * (axis - normal)``, with one pull for all: what was said is a line over
    the axes, fitted with weights ``1 / sigma**2`` and a prior for its slope, the pull.

    Parameters
    ----------
    normals
        Normals as each look says, unit vectors, shape (n, 3).
    axes
        Reversed optical axis of each look, unit vectors, shape (n, 3).
    sigmas
        Standard deviation of each look, shape (n,), rad.

    Examples
    --------
    >>> from gvp_lib.planning import fused
    >>> axes = np.array([[0.0, 0.1, 0.995], [0.0, -0.1, 0.995]])
    >>> normals = np.array([[0.0, 0.01, 1.0], [0.0, -0.01, 1.0]])
    >>> normal, sd = fused(normals, axes, np.array([0.03, 0.03]))
    >>> normal.round(3).tolist(), bool(sd < 0.03)
    ([0.0, 0.0, 1.0], True)
    """
    normals, axes, sigmas = (np.asarray(each, float) for each in (normals, axes, sigmas))
    shapes = normals.shape, axes.shape, sigmas.shape
    n = sigmas.size
    if not n or shapes != ((n, 3), (n, 3), (n,)) or not (np.isfinite(sigmas) & (sigmas > 0)).all():
        raise InvalidParameterError(
            "looks are fused by normals and axes of shape (n, 3) and standard deviations, positive and finite, (n,); "
            f"got shapes {shapes}, and sigmas={sigmas}"
        )
    weights = (sigmas.min() / sigmas) ** 2
    variance = sigmas.min() ** 2 / weights.sum()  # of the weighted mean, rad^2
    weights /= weights.sum()
    said, axis = weights @ normals, weights @ axes
    spread = weights @ ((axes - axis) ** 2).sum(axis=1) + variance / _PULL_SD**2
    pull = min(weights @ ((axes - axis) * (normals - said)).sum(axis=1) / spread, _MOST_PULL)
    offset = (said - axis) / (1 - pull)
    variance *= 1 + offset @ offset / spread
    return axis + offset, float(np.sqrt(variance)) / (1 - pull)
