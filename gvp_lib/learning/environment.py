"""The thesis's state, action and reward as a Gymnasium environment, and episodes of any policy in it.

Thesis 2.4; 2.4.3; Eq. 2.10; errata 16 to 19.

Importing this module registers ``gvp_lib/Viewpoint-v0``, whose episodes are truncated after 50 steps. Gymnasium can
import it too: ``gymnasium.make("gvp_lib.learning.environment:gvp_lib/Viewpoint-v0")``.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import GvpError, InvalidParameterError, UnknownNameError, UnreachableError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.learning.labels import label_view
from gvp_lib.learning.recipe import CollectionRecipe, Painter, Variation, resized
from gvp_lib.motion.arm import Motion, StopReason
from gvp_lib.motion.centering import center_on_object
from gvp_lib.motion.primitives import toward_pixel
from gvp_lib.motion.sighting import Eye
from gvp_lib.perception.images import shrunk
from gvp_lib.planning.plan import Action
from gvp_lib.simulation.arms import ArmSpec
from gvp_lib.simulation.objects import ObjectSpec, object_spec
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import WorkCell

__all__ = ["ENV_ID", "PARTS", "Outcome", "Rollout", "ViewpointEnv", "oracle_policy", "random_policy", "rollout"]

ENV_ID = "gvp_lib/Viewpoint-v0"
PARTS = ("image", "believed_pose", "true_pose", "object_pose")
"""Parts of the state that can be observed; :class:`ViewpointEnv` says what each is."""

REWARDS, VIEWS = ("error", "progress"), ("overview", "camera")
_PLACES, _STARTS = 10, 20  # places of the object that are tried, and starts at each
_FAR = 10.0  # m: no arm and no object stands so far from the base
_POSE_LIMIT = np.array([_FAR] * 3 + [1.0] * 6)


class Outcome(StrEnum):
    """State of an episode: under way, or why it ended."""

    UNDER_WAY = "under way"
    STOPPED = "stopped"  # by NO_OP
    TARGET_LOST = "target lost"
    NOT_CENTERED = "not centered"  # the arm moves, and the object does not come to the middle of the picture
    JOINT_LIMIT = "joint limit"
    COLLISION = "collision"
    UNREACHABLE = "unreachable"
    CONTACT = "contact"
    STALLED = "stalled"

    @property
    def failed(self) -> bool:
        """Whether the arm could not do what the action asked for."""
        return self not in (Outcome.UNDER_WAY, Outcome.STOPPED)


class ViewpointEnv(gymnasium.Env[Any, Any]):
    """Bring a camera over a virtual sphere to where it looks along an object's normal.

    An episode begins on the sphere, uniform in area over a cap about the normal and at any roll, with the object off
    the middle of the picture, which is then centered (Algorithm 1). Each action is a step over the sphere and a
    centering; ``NO_OP`` ends the episode (2.4.5), as does a step that the arm cannot make or after which the object is
    lost, or does not come to the middle. An environment from :func:`gymnasium.make` truncates it after 50 steps; one
    from this class does not.

    **Observations.** With one part in ``observe`` the observation is its array, with several a dictionary of them:

    - ``"image"``: uint8 (size, size, 3), RGB, cropped and resized as in 2.4.3; with ``frames`` of k > 1 the last k
      of them, (k, size, size, 3), oldest first. At the start the first is repeated.
    - ``"believed_pose"``: the camera's, ``base_from_camera``, as the arm believes it; ``"true_pose"``: as it truly is;
      ``"object_pose"``: ``base_from_object``, true. Each float32 (9,): position, m, then the frame's x and y axes as
      unit vectors, which unlike a quaternion have no sign that leaps where the camera looks straight down.

    **Rewards**, rad. A failed step counts as an error of pi, so that failing never pays more than ``NO_OP``.

    - ``"error"``: minus the viewpoint error after the action (Eq. 2.10, corrected). It ranks the actions at one
      viewpoint, as the thesis's labels do. Beware of summing it: stopping at once often has the largest sum, since each
      step on the way costs the error that is left.
    - ``"progress"``: decrease of the error by the action. Its undiscounted sum is the error at the start minus that at
      the end, so that whoever maximizes it aligns the camera.

    **Info**, at every reset and step, is the truth and not for the policy: ``viewpoint_error``, rad; ``best_action``,
    the label of the viewpoint; ``outcome``, an :class:`Outcome`; ``success``, whether ``NO_OP`` came within
    ``rew_thresh``.

    Parameters
    ----------
    observe
        Parts of the state to observe, of the four above.
    frames
        Number k of pictures in ``"image"``.
    crop
        Side of the middle square taken of each picture, px; None: all of it.
    size
        Side of the resized picture, px, the shorter one where all of it is taken; None: not resized.
    arm, target, placement, noise, variation, radius, step, max_tilt, threshold
        As in :class:`CollectionRecipe`; all that varies is drawn once for each episode.
    off_center
        Largest distance of the object from the middle of the picture before the start is centered, px.
    rew_thresh
        Viewpoint error up to which stopping is a success, rad.
    reward
        ``"error"`` or ``"progress"``.
    render_mode
        ``"rgb_array"`` or None.
    render_view
        View to render: ``"overview"``, the cell from the front, or ``"camera"``, the whole picture.

    Examples
    --------
    >>> env = ViewpointEnv(arm="floating")
    >>> image, info = env.reset(seed=1)
    >>> image.shape, info["best_action"] in range(5), str(info["outcome"])
    ((64, 64, 3), True, 'under way')
    >>> _, reward, terminated, _, after = env.step(info["best_action"])
    >>> terminated, after["viewpoint_error"] < info["viewpoint_error"], reward == -after["viewpoint_error"]
    (False, True, True)
    >>> env.close()
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 4}  # noqa: RUF012 - Gymnasium's own form

    def __init__(
        self,
        *,
        observe: str | Sequence[str] = ("image",),
        frames: int = 1,
        crop: int | None = 128,
        size: int | None = 64,
        arm: str | ArmSpec = "ur5e",
        target: str | ObjectSpec = "cuboid_1x2",
        placement: str = "flat",
        noise: Noise | None = None,
        variation: Variation | None = None,
        radius: float = 0.5,
        step: float = np.radians(5),
        max_tilt: float = np.radians(30),
        threshold: float = 2.0,
        off_center: float = 100.0,
        rew_thresh: float = np.radians(5),
        reward: Literal["error", "progress"] = "error",
        render_mode: str | None = None,
        render_view: Literal["overview", "camera"] = "overview",
    ) -> None:
        self._observer = _Observer(observe, frames, crop, size)
        if not 0 <= off_center <= 200:
            raise InvalidParameterError(
                f"off_center is in px, from 0 to 200, where the object is in sight; got {off_center}"
            )
        if not 0 < rew_thresh <= np.pi:
            raise InvalidParameterError(
                f"rew_thresh is in radians, in (0, pi]; got {rew_thresh}. For degrees: np.radians(...)"
            )
        for kind, value, known in (("reward", reward, REWARDS), ("render_view", render_view, VIEWS)):
            if value not in known:
                raise UnknownNameError(kind, value, known)
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise UnknownNameError("render mode", render_mode, self.metadata["render_modes"])
        # Checks what the two have in common, and says what would do.
        self.recipe = CollectionRecipe(
            arm=arm, target=target, placement=placement, noise=noise or Noise(), variation=variation or Variation(),
            radius=radius, step=step, max_tilt=max_tilt, threshold=threshold, crop=128 if crop is None else crop,
        )  # fmt: skip
        self.off_center, self.rew_thresh, self.reward = off_center, rew_thresh, reward
        self.render_mode, self.render_view = render_mode, render_view
        self._cell = self._new_cell(1.0)
        self.observation_space = self._observer.space(self._cell.arm.intrinsics)
        self.action_space = spaces.Discrete(len(Action))
        self._outcome: Outcome | None = None  # before the first reset

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode: place the object and draw everything random anew; a ``seed`` decides it all.

        Raises
        ------
        GvpError
            No start within reach of the arm was found.
        """
        super().reset(seed=seed)
        if options:
            raise InvalidParameterError(
                f"reset takes no options; got {options}. What an episode is like is for the constructor to say"
            )
        self._outcome = None  # of the episode before, if there is none to follow it
        self._draw_start()
        self._outcome = Outcome.UNDER_WAY
        self._observer.begin(self._rgb)
        self._error = self._cell.truth.viewpoint_error()
        return self._observer.observation(self._cell), self._info()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Do one of the five :class:`Action`; see the class for what comes back.

        Raises
        ------
        InvalidParameterError
            There is no such action.
        GvpError
            No episode is under way.
        """
        if not self.action_space.contains(action):
            named = ", ".join(f"{int(each)} ({each.name})" for each in Action)
            raise InvalidParameterError(f"an action is one of the whole numbers {named}; got {action!r}")
        if self._outcome is not Outcome.UNDER_WAY:
            raise GvpError("no episode is under way; call reset() to begin one")
        if action == Action.NO_OP:
            self._outcome = Outcome.STOPPED
        else:
            move = Action(int(action)).step(self.recipe.step, self.recipe.radius)
            self._outcome = self._took_up(self._cell.arm.move_camera(move))
            self._observer.add(self._rgb)
        before, self._error = self._error, self._cell.truth.viewpoint_error()
        counted = np.pi if self._outcome.failed else self._error
        reward = before - counted if self.reward == "progress" else -counted
        ended = self._outcome is not Outcome.UNDER_WAY
        return self._observer.observation(self._cell), float(reward), ended, False, self._info()

    def render(self) -> NDArray[np.uint8] | None:
        """Picture of the cell or of the camera, RGB uint8 (480, 640, 3); None without a ``render_mode``."""
        if self.render_mode is None:
            return None
        if self.render_view == "overview":
            return self._cell.overview(640, 480)
        if self._outcome is None:
            raise GvpError("the camera has taken no picture yet; call reset() first")
        return self._rgb.copy()  # another capture would draw other noise, and so change the episode

    def close(self) -> None:
        """Free the graphics contexts."""
        self._cell.close()

    def _new_cell(self, factor: float) -> WorkCell:
        recipe, target = self.recipe, object_spec(self.recipe.target).centered()
        cell = WorkCell(recipe.arm, resized(target, factor), recipe.placement, noise=recipe.noise)
        self._painter: Painter | None = None
        return cell

    def _draw_start(self) -> None:
        """Place the object and draw viewpoints until the arm can take one up, the object in the middle."""
        for _ in range(_PLACES):
            self._place_object()
            truth, recipe = self._cell.truth, self.recipe
            sphere = VirtualSphere(truth.world_from_object.translation, recipe.radius, truth.normal.direction)
            for _ in range(_STARTS):
                facing = sphere.random(1, self.np_random, recipe.max_tilt, sigma=None)[0]
                try:
                    self._cell.place_camera(facing * self._turned_away())
                except UnreachableError:
                    continue
                if self._took_up(Motion(True, StopReason.REACHED)) is Outcome.UNDER_WAY:
                    return
        raise GvpError(
            f"none of {_STARTS} starts at any of {_PLACES} places of the object could be taken up by the arm "
            f"{recipe.arm!r}, at a radius of {recipe.radius} m and tilts up to {np.degrees(recipe.max_tilt):.0f} deg. "
            "Does the segmenter find the object? A smaller radius, max_tilt or off_center may do, or another placement"
        )

    def _place_object(self) -> None:
        size = self.recipe.variation.size
        factor = 1 + size * float(self.np_random.uniform(-1, 1))
        if size:  # an object of another size is another scene
            self._cell.close()
            self._cell = self._new_cell(factor)
        model = self._cell.model
        self._cell.reset(int(self.np_random.integers(2**63)))
        if self._painter is None or self._cell.model is not model:  # leaning, it may need another block: another scene
            self._painter = Painter(self._cell, self.recipe.variation)
        self._painter.paint(self.np_random)

    def _turned_away(self) -> RigidTransform:
        """``facing_from_camera``: a rotation that takes the object off the middle, to a point uniform over a disk."""
        off, direction = self.off_center * np.sqrt(self.np_random.uniform()), self.np_random.uniform(0, 2 * np.pi)
        lens = self._cell.arm.intrinsics
        pixel = lens.principal_point + off * np.array([np.cos(direction), np.sin(direction)])
        return RigidTransform.from_rotation(toward_pixel(lens, pixel).inv())

    def _took_up(self, motion: Motion) -> Outcome:
        """Outcome of a motion and the centering after it (Algorithm 1), of which the last picture is kept."""
        arm = self._cell.arm
        if not motion:
            self._rgb = arm.capture()
            return Outcome(motion.reason.value)

        def keep(rgb: NDArray[np.uint8], _: object) -> None:
            self._rgb = rgb

        eye = Eye(arm, self._cell.segmenter, on_look=keep)
        centered = center_on_object(eye, threshold=self.recipe.threshold)
        return Outcome.UNDER_WAY if centered else Outcome(centered.trouble)

    def _info(self) -> dict[str, Any]:
        truth = self._cell.truth
        return {
            "viewpoint_error": float(self._error),
            "best_action": int(label_view(truth.world_from_camera, truth.normal, self.recipe.step).action),
            "outcome": self._outcome,
            "success": bool(self._outcome is Outcome.STOPPED and self._error <= self.rew_thresh),
        }


# --- what is observed -----------------------------------------------------------------------------------------------


class _Observer:
    """What of a work cell is observed: its parts, and the memory of the last pictures."""

    def __init__(self, observe: str | Sequence[str], frames: int, crop: int | None, size: int | None) -> None:
        self.parts = (observe,) if isinstance(observe, str) else tuple(observe)
        for part in self.parts:
            if part not in PARTS:
                raise UnknownNameError("part of an observation", part, PARTS)
        if not self.parts or len(set(self.parts)) < len(self.parts):
            raise InvalidParameterError(
                f"an observation is of one or more different parts, of {', '.join(PARTS)}; got {list(self.parts)}"
            )
        for name, value, least in (("frames", frames, 1), ("size", 8 if size is None else size, 8)):
            if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
                raise InvalidParameterError(f"{name} is a whole number, {least} or more; got {value!r}")
        self.frames, self.crop, self.size = int(frames), crop, size
        self._pictures: deque[NDArray[np.uint8]] = deque(maxlen=self.frames)

    def space(self, lens: CameraIntrinsics) -> spaces.Space[Any]:
        """Space of the observations from a camera with this lens: a Box, or a Dict of several."""
        shape = shrunk(np.zeros((lens.height, lens.width, 3), np.uint8), self.crop, self.size).shape
        shape = shape if self.frames == 1 else (self.frames, *shape)
        high = _POSE_LIMIT.astype(np.float32)
        boxes: dict[str, spaces.Space[Any]] = {
            part: spaces.Box(0, 255, shape, np.uint8) if part == "image" else spaces.Box(-high, high, dtype=np.float32)
            for part in self.parts
        }
        return boxes[self.parts[0]] if len(boxes) == 1 else spaces.Dict(boxes)

    def begin(self, rgb: NDArray[np.uint8]) -> None:
        """Forget the pictures of the last episode; the first of this one is repeated for those before it."""
        self._pictures.extend([shrunk(rgb, self.crop, self.size)] * self.frames)

    def add(self, rgb: NDArray[np.uint8]) -> None:
        """Add a whole picture; the oldest is forgotten."""
        self._pictures.append(shrunk(rgb, self.crop, self.size))

    def observation(self, cell: WorkCell) -> Any:
        """Observed parts, in new arrays: the only one, or a dictionary of several."""
        parts = {part: self._part(part, cell) for part in self.parts}
        return parts[self.parts[0]] if len(parts) == 1 else parts

    def _part(self, part: str, cell: WorkCell) -> NDArray[Any]:
        if part == "image":
            return np.array(self._pictures if self.frames > 1 else self._pictures[-1])
        if part == "believed_pose":
            return _numbers(cell.arm.camera_pose())
        return _numbers(cell.truth.world_from_camera if part == "true_pose" else cell.truth.world_from_object)


def _numbers(pose: RigidTransform) -> NDArray[np.float32]:
    """Position, m, and the x and y axes of a frame, shape (9,)."""
    axes = pose.rotation.as_matrix()[:, :2].T.ravel()
    return np.concatenate([pose.translation, axes]).clip(-_POSE_LIMIT, _POSE_LIMIT).astype(np.float32)


# --- episodes -------------------------------------------------------------------------------------------------------


_Policy = Callable[[Any, dict[str, Any]], int]  # from an observation and an info to the number of an Action


def oracle_policy(observation: Any, info: dict[str, Any]) -> int:
    """Policy that knows the truth: the label of the viewpoint, the action with the largest reward (thesis 2.4.2)."""
    return int(info["best_action"])


def random_policy(rng: np.random.Generator | int) -> _Policy:
    """Policy that draws each of the five actions with equal probability; ``rng`` is a generator, or a seed."""
    generator = np.random.default_rng(rng)

    def policy(observation: Any, info: dict[str, Any]) -> int:
        return int(generator.integers(len(Action)))

    return policy


@dataclass(frozen=True, eq=False)
class Rollout:
    """A finished episode.

    Attributes
    ----------
    actions
        Numbers of the actions, shape (n,).
    rewards
        Rewards, shape (n,), rad.
    errors
        Viewpoint error at the start and after each action, shape (n + 1,), rad.
    outcome
        Why it ended; ``"under way"`` where it was truncated.
    success
        Whether it was stopped within the environment's threshold.
    """

    actions: NDArray[np.int64]
    rewards: NDArray[np.float64]
    errors: NDArray[np.float64]
    outcome: str
    success: bool

    def returned(self, discount: float = 1.0) -> float:
        """Sum of the rewards, each discounted once for every action before it, rad."""
        return float(self.rewards @ discount ** np.arange(len(self.rewards)))


def rollout(env: gymnasium.Env[Any, Any], policy: _Policy, seed: int | None = None) -> Rollout:
    """Run one episode of a policy.

    Parameters
    ----------
    env
        A :class:`ViewpointEnv`; from :func:`gymnasium.make`, so that an episode ends that nobody stops.
    policy
        From an observation and an info to the number of an :class:`Action`. A policy to be deployed looks at the first
        alone; :func:`random_policy` and :func:`oracle_policy` frame every other.
    seed
        Seed of the episode; None: the next one.

    Examples
    --------
    >>> env = gymnasium.make(ENV_ID, arm="floating")
    >>> episode = rollout(env, oracle_policy, seed=3)
    >>> episode.outcome, episode.success, len(episode.errors) - len(episode.actions)
    ('stopped', True, 1)
    >>> env.close()
    """
    observation, info = env.reset(seed=seed)
    actions: list[int] = []
    rewards: list[float] = []
    errors = [info["viewpoint_error"]]
    over = False
    while not over:
        actions.append(policy(observation, info))
        observation, reward, terminated, truncated, info = env.step(actions[-1])
        rewards.append(float(reward))
        errors.append(info["viewpoint_error"])
        over = terminated or truncated
    return Rollout(np.array(actions), np.array(rewards), np.array(errors), str(info["outcome"]), info["success"])


if ENV_ID not in gymnasium.registry:
    gymnasium.register(ENV_ID, entry_point=f"{__name__}:ViewpointEnv", max_episode_steps=50)
