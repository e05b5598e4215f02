"""The thesis's state, action and reward as a Gymnasium environment. Thesis 2.4; 2.4.3; Eq. 2.10; errata 16 to 19.

Importing this module registers ``gvp_lib/Viewpoint-v0``, whose episodes are truncated after 50 steps. Gymnasium can
import it by itself: ``gymnasium.make("gvp_lib.learning.environment:gvp_lib/Viewpoint-v0")``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.checks import checked
from gvp_lib.errors import GvpError, InvalidParameterError, UnknownNameError, UnreachableError
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.learning.labels import label_view
from gvp_lib.learning.recipe import CollectionRecipe, Painter, Variation, scaled_object
from gvp_lib.motion.arm import Outcome
from gvp_lib.motion.primitives import toward_pixel
from gvp_lib.motion.sighting import Eye, center_on_object
from gvp_lib.perception.images import crop_and_resize
from gvp_lib.planning.plan import Action
from gvp_lib.simulation.arms import ArmSpec
from gvp_lib.simulation.objects import ObjectSpec, object_spec
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import WorkCell

__all__ = ["ENV_ID", "PARTS", "ViewpointEnv"]

ENV_ID = "gvp_lib/Viewpoint-v0"
PARTS = ("image", "believed_pose", "true_pose", "object_pose")
"""Parts of the state that can be observed, described in :class:`ViewpointEnv`."""

REWARDS, VIEWS = ("error", "progress"), ("overview", "camera")
_PLACES, _STARTS = 10, 20  # places of the object that are tried, and starts at each
_POSE_LIMIT = np.array([10.0] * 3 + [1.0] * 6, np.float32)  # m, and unit vectors: nothing stands so far from the base


@checked
class ViewpointEnv(gymnasium.Env[Any, Any]):
    """Gymnasium environment: move a camera over a virtual sphere until it looks along an object's normal.

    An episode begins on the sphere, uniform in area over a cap about the normal and at any roll, with the object away
    from the middle of the picture, where the camera then centers it (Algorithm 1). Each action is a step over the
    sphere, followed by centering. ``NO_OP`` ends the episode (2.4.5), as does a step that the arm cannot make or after
    which the object is lost or cannot be centered. An environment from :func:`gymnasium.make` truncates an episode
    after 50 steps; one constructed from this class does not.

    **Observations.** With one part in ``observe`` the observation is its array, with several a dictionary of arrays:

    - ``"image"``: RGB uint8 (size, size, 3), cropped and resized as in 2.4.3. For the last k of them, see
      ``gymnasium.wrappers.FrameStackObservation``.
    - ``"believed_pose"``: pose of the camera, ``base_from_camera``, as the arm believes it; ``"true_pose"``: its true
      pose; ``"object_pose"``: true pose of the object, ``base_from_object``. Each is float32 (9,): position, m, then
      the frame's x and y axes as unit vectors, whose signs, unlike a quaternion's, do not jump where the camera looks
      straight down.

    **Rewards**, rad. A failed step counts as an error of pi, so that failing never pays more than ``NO_OP``.

    - ``"error"``: minus the viewpoint error after the action (Eq. 2.10, corrected). It ranks the actions at one
      viewpoint, as the thesis's labels do. Beware of summing it: stopping at once often has the largest sum, since each
      step on the way costs the remaining error.
    - ``"progress"``: decrease of the error by the action. Its undiscounted sum is the error at the start minus the
      error at the end, so that a policy that maximizes it aligns the camera.

    **Info**, at every reset and step, is the truth and not for the policy: ``viewpoint_error``, rad; ``best_action``,
    the label of the viewpoint and so an oracle's answer; ``outcome``, an :class:`gvp_lib.motion.Outcome`, which is
    also its text: ``"under way"``, ``"aligned"`` by ``NO_OP``, which is what the policy says, or what went wrong;
    ``success``, whether ``NO_OP`` came within ``rew_thresh``.

    **Several at once**: ``gymnasium.vector.SyncVectorEnv``, or ``AsyncVectorEnv(..., context="spawn")``. A process
    that was forked from one that has drawn cannot draw, and says so.

    Parameters
    ----------
    observe
        Parts of the state to observe: one or several of the four above.
    crop
        Side of the square taken from the middle of each picture, px; None: the whole picture.
    size
        Side of the resized picture, px, or its shorter side where ``crop`` is None; None: not resized.
    arm, target, placement, noise, variation, radius, step, max_tilt, threshold
        As in :class:`CollectionRecipe`; everything random is drawn once per episode.
    off_center
        Largest distance of the object from the middle of the picture before it is centered at the start, px.
    rew_thresh
        Largest viewpoint error at which stopping is a success, rad.
    reward
        Kind of reward: ``"error"`` or ``"progress"``.
    render_mode
        Gymnasium's render mode: ``"rgb_array"``, or None for no rendering.
    render_view
        View to render: ``"overview"``, the cell from the front; or ``"camera"``, the camera's whole picture.

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
        self.parts = (observe,) if isinstance(observe, str) else tuple(observe)
        for kind, name, known in (
            *(("part of an observation", part, PARTS) for part in self.parts),
            ("reward", reward, REWARDS),
            ("render mode", render_mode or "rgb_array", self.metadata["render_modes"]),
            ("render view", render_view, VIEWS),
        ):
            if name not in known:
                raise UnknownNameError(kind, name, known)
        if not self.parts or len(set(self.parts)) < len(self.parts):
            raise InvalidParameterError(f"observe is one or more different parts of {', '.join(PARTS)}; got {observe}")
        if size is not None and (isinstance(size, bool) or not isinstance(size, int | np.integer)):
            raise InvalidParameterError(f"size is a whole number of px, or None for no resizing; got {size!r}")
        for name, value, low, high, unit in (
            ("size", 64 if size is None else size, 8, 4096, "px"),
            ("off_center", off_center, 0, 200, "px, where the object is in sight"),
            ("rew_thresh", rew_thresh, 0, np.pi, "rad, np.radians(...) of degrees"),
        ):
            if not low <= value <= high:
                raise InvalidParameterError(f"{name} is from {low} to {high:.4g} {unit}; got {value}")
        # Checks what the two have in common, and says what would do.
        self.recipe = CollectionRecipe(
            arm=arm, target=target, placement=placement, noise=noise or Noise(), variation=variation or Variation(),
            radius=radius, step=step, max_tilt=max_tilt, threshold=threshold, crop=128 if crop is None else crop,
        )  # fmt: skip
        self.crop, self.size, self.off_center, self.rew_thresh = crop, size, off_center, rew_thresh
        self.reward, self.render_mode, self.render_view = reward, render_mode, render_view
        self._cell = self._new_cell(1.0)
        self._outcome: Outcome | None = None
        lens, far = self._cell.arm.intrinsics, _POSE_LIMIT
        shape = crop_and_resize(np.zeros((lens.height, lens.width, 3), np.uint8), crop, size).shape
        boxes: dict[str, spaces.Space[Any]] = {
            part: spaces.Box(0, 255, shape, np.uint8) if part == "image" else spaces.Box(-far, far, dtype=np.float32)
            for part in self.parts
        }
        self.observation_space = boxes[self.parts[0]] if len(boxes) == 1 else spaces.Dict(boxes)
        self.action_space = spaces.Discrete(len(Action))

    def __repr__(self) -> str:
        arm, target = (getattr(spec, "name", spec) for spec in (self.recipe.arm, self.recipe.target))
        return f"ViewpointEnv({arm}, {target}, observes {', '.join(self.parts)}, reward {self.reward})"

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode: place the object and draw everything random anew.

        Parameters
        ----------
        seed
            Seed of everything random; None: the generator continues.
        options
            Empty or None: all options are the constructor's.

        Raises
        ------
        GvpError
            No start within reach of the arm was found.
        """
        super().reset(seed=seed)
        if options:
            raise InvalidParameterError(f"reset takes no options, the constructor takes them all; got {options}")
        self._outcome = None  # should no start be found, no episode is under way
        self._draw_start()
        self._outcome = Outcome.UNDER_WAY
        self._error = self._cell.truth.viewpoint_error()
        return self._observation(), self._info()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Take one of the five actions; the class describes observation, reward and info.

        Parameters
        ----------
        action
            Number of an :class:`Action`.

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
            self._outcome = Outcome.ALIGNED
        elif motion := self._cell.arm.move_camera(Action(int(action)).step(self.recipe.step, self.recipe.radius)):
            self._outcome = self._center()
        else:
            self._outcome, self._rgb = motion.reason, self._cell.arm.capture()
        before, self._error = self._error, self._cell.truth.viewpoint_error()
        counted = self._error if self._outcome in (Outcome.UNDER_WAY, Outcome.ALIGNED) else np.pi
        reward = before - counted if self.reward == "progress" else -counted
        return self._observation(), float(reward), self._outcome is not Outcome.UNDER_WAY, False, self._info()

    def render(self) -> NDArray[np.uint8] | None:
        """Picture of the cell or of the camera, RGB uint8 (480, 640, 3); None without a ``render_mode``."""
        if self.render_mode is None:
            return None
        if self.render_view == "overview":
            return self._cell.overview(640, 480)
        if not self._outcome:
            raise GvpError("the camera has taken no picture yet; call reset() first")
        return self._rgb.copy()  # another capture would draw other noise, and so change the episode

    def close(self) -> None:
        """Free the graphics contexts."""
        self._cell.close()

    def _new_cell(self, factor: float) -> WorkCell:
        recipe, target = self.recipe, object_spec(self.recipe.target).centered()
        self._painter: Painter | None = None
        return WorkCell(recipe.arm, scaled_object(target, factor), recipe.placement, noise=recipe.noise)

    def _draw_start(self) -> None:
        """Place the object and draw viewpoints until the arm can take one up, the object in the middle."""
        for _ in range(_PLACES):
            self._place_object()
            truth, recipe, lens = self._cell.truth, self.recipe, self._cell.arm.intrinsics
            sphere = VirtualSphere(truth.world_from_object.translation, recipe.radius, truth.normal.direction)
            for _ in range(_STARTS):
                facing = sphere.random(1, self.np_random, recipe.max_tilt, sigma=None)[0]
                # The object at a point uniform over a disk about the middle of the picture.
                off, angle = self.off_center * np.sqrt(self.np_random.uniform()), self.np_random.uniform(0, 2 * np.pi)
                pixel = lens.principal_point + off * np.array([np.cos(angle), np.sin(angle)])
                facing_from_camera = RigidTransform.from_rotation(toward_pixel(lens, pixel).inv())
                try:
                    self._cell.place_camera(facing * facing_from_camera)
                except UnreachableError:
                    continue
                if self._center() is Outcome.UNDER_WAY:
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

    def _center(self) -> Outcome:
        """Outcome of a centering (Algorithm 1), of which the last picture is kept."""

        def keep(rgb: NDArray[np.uint8], _: object) -> None:
            self._rgb = rgb

        eye = Eye(self._cell.arm, self._cell.segmenter, on_look=keep)
        centered = center_on_object(eye, threshold=self.recipe.threshold)
        return Outcome.UNDER_WAY if centered else centered.outcome

    def _observation(self) -> Any:
        """Observed parts, in new arrays: the only one, or a dictionary of several."""
        truth = self._cell.truth
        poses = {
            "believed_pose": self._cell.arm.camera_pose(),
            "true_pose": truth.world_from_camera,
            "object_pose": truth.world_from_object,
        }
        parts: dict[str, Any] = {"image": crop_and_resize(self._rgb, self.crop, self.size).copy()}
        for part, pose in poses.items():
            axes = pose.rotation.as_matrix()[:, :2].T.ravel()
            parts[part] = np.concatenate([pose.translation, axes]).astype(np.float32)
        return parts[self.parts[0]] if len(self.parts) == 1 else {part: parts[part] for part in self.parts}

    def _info(self) -> dict[str, Any]:
        truth = self._cell.truth
        return {
            "viewpoint_error": float(self._error),
            "best_action": int(label_view(truth.world_from_camera, truth.normal, self.recipe.step).action),
            "outcome": self._outcome,
            "success": bool(self._outcome is Outcome.ALIGNED and self._error <= self.rew_thresh),
        }


if ENV_ID not in gymnasium.registry:
    gymnasium.register(ENV_ID, entry_point=f"{__name__}:ViewpointEnv", max_episode_steps=50)
