"""The work cell: an arm, an object on a table, and the truth about both. Thesis 1.2, 3.1.1; Fig. 3.1."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError, ModelError, UnknownNameError, UnreachableError
from gvp_lib.motion.arm import EyeInHandArm, Gripper
from gvp_lib.perception.segmentation import Segmenter
from gvp_lib.simulation.arms import ARMS, ArmSpec, arm_spec
from gvp_lib.simulation.assembly import JointedArm, Watchers, assemble
from gvp_lib.simulation.frames import checked_pose
from gvp_lib.simulation.objects import ObjectSpec, object_spec
from gvp_lib.simulation.placements import Layout, Placed
from gvp_lib.simulation.scene import FLOATING, OVERVIEW, TARGET, Stage, aim_overview, build_scene, move_support
from gvp_lib.simulation.sensors import EpisodeNoise, Noise, renderer
from gvp_lib.simulation.truth import Truth

__all__ = ["WorkCell"]


class WorkCell:
    """A simulated cell with one arm and one object to grasp.

    The cell holds no planner and no segmenter of yours: call them with what ``arm`` gives, as in
    ``my_segmenter(cell.arm.capture())``. ``cell.segmenter`` is the one that was tuned for the target.

    Parameters
    ----------
    arm
        ``"baxter"``, ``"ur5e"``, ``"floating"`` (a camera without an arm), or an :class:`ArmSpec` of your own.
    target
        The object to grasp: a name in ``OBJECTS``, or an :class:`ObjectSpec` of your own.
    placement
        ``"flat"``: on the table; ``"raised"``: level on a block; ``"side"``: lying on a side face; ``"tilted"``:
        leaning on a block, 15 to 30 deg off the vertical; ``"walled"``: on the table, one long side hidden by a block.
    noise
        How imperfect the cell is; nothing is, by default.
    seed
        Of everything random: where the object stands, its yaw, the noise. The same seed gives the same cell,
        to the last bit of every frame.
    others
        More objects, which stand flat on the table beside the target.
    dynamic
        Whether servos push the joints through time and contacts push back. Otherwise the arm is simply where
        it was told to be and objects stay where they are, which is far faster.
    shadows, highlights
        Whether the lamp casts shadows (at six times the cost of a frame without a GPU) and surfaces shine.

    Attributes
    ----------
    arm
        What a planner may see.
    truth
        What only a judge may see.
    model, data
        The MuJoCo scene, for whoever draws or inspects it.

    Examples
    --------
    >>> cell = WorkCell(arm="ur5e", target="cuboid_1x2", seed=7)
    >>> cell.arm.capture().shape
    (480, 640, 3)
    """

    arm: EyeInHandArm
    truth: Truth
    model: mujoco.MjModel
    data: mujoco.MjData

    def __init__(
        self,
        arm: str | ArmSpec = "baxter",
        target: str | ObjectSpec = "cuboid_1x2",
        placement: str = "flat",
        *,
        noise: Noise | None = None,
        seed: int | np.random.SeedSequence = 0,
        others: Sequence[str | ObjectSpec] = (),
        dynamic: bool = False,
        shadows: bool = False,
        highlights: bool = False,
    ) -> None:
        self.arm_spec = None if arm == FLOATING else _known_arm(arm)
        self.target_spec = object_spec(target)
        if not isinstance(noise, Noise | None):
            raise InvalidParameterError(f"noise is a Noise, such as Noise.thesis(), or None; got {noise!r}")
        if dynamic and self.arm_spec is None:
            raise InvalidParameterError("a floating camera has no dynamics; choose an arm, or dynamic=False")
        self._noise_level = noise or Noise.none()
        self._dynamic, self._shadows, self._highlights = dynamic, shadows, highlights
        self._watchers = Watchers()
        self._overview: mujoco.Renderer | None = None
        spec = self.arm_spec
        self.stage = Stage(spec.table_height, spec.floor_height, spec.workspace) if spec else Stage()
        self._layout = Layout(self.target_spec, placement, others, self.stage)
        self._supports = -1  # the number of blocks that the compiled scene has
        self.truth = Truth(self.target_spec)
        self._seed = seed
        self.reset(seed)

    def __enter__(self) -> WorkCell:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    # --- an episode -----------------------------------------------------------------------------------------

    def reset(
        self,
        seed: int | np.random.SeedSequence | None = None,
        *,
        noise_seed: np.random.SeedSequence | None = None,
    ) -> None:
        """Begin an episode: place the object anew, draw the noise, send the arm home, set the clock to zero.

        Parameters
        ----------
        seed
            As in the constructor; None repeats the present episode.
        noise_seed
            Seed of the noise alone, for another episode with the object where it was; by default ``seed`` decides.
        """
        self._seed = self._seed if seed is None else seed
        for_places, for_noise = _seed_sequence(self._seed).spawn(2)
        placed, beside = self._layout.at_rest(for_places)
        if len(placed.supports) != self._supports:
            self._build(placed)
        mujoco.mj_resetData(self.model, self.data)
        for i, support in enumerate(placed.supports):
            move_support(self.model, self.data, i, support)
        for name, where in zip(self._names(), [placed, *beside], strict=True):
            self._put_object(name, where.world_from_object)
        holder, joints = self._assembly.holder, len(self.arm_spec.joints) if self.arm_spec else 0
        self._noise = EpisodeNoise(self._noise_level, joints, noise_seed or for_noise)
        if isinstance(holder, JointedArm):
            assert self.arm_spec is not None
            holder.arm.begin_episode(self._noise)
            holder.arm.stand_at(self.arm_spec.home + self._noise.joint_offset)  # where the encoders read home
            if holder.gripper is not None:
                holder.gripper.begin_episode(self._noise)
        else:
            holder.begin_episode(self._noise)
        mujoco.mj_forward(self.model, self.data)
        aim_overview(self.model, self.data, self.stage)
        mujoco.mj_camlight(self.model, self.data)
        self.truth.begin_episode(self.data, self.model.body(TARGET).id, self._assembly.camera)

    @property
    def seed(self) -> int | np.random.SeedSequence:
        """The present episode's seed; :meth:`reset` takes another."""
        return self._seed

    @property
    def placement(self) -> str:
        """How the target is placed."""
        return self._layout.placement

    @property
    def noise(self) -> Noise:
        """How imperfect the cell is."""
        return self._noise_level

    @property
    def gripper(self) -> Gripper:
        """The arm's gripper, with the range sensor in its palm."""
        holder = self._assembly.holder
        if not isinstance(holder, JointedArm) or holder.gripper is None:
            name = self.arm_spec.name if self.arm_spec else FLOATING
            having = [spec.name for spec in ARMS.values() if spec.gripper is not None]
            raise ModelError(f"arm {name!r} has no gripper; of the known arms, {', '.join(having)} has one")
        return holder.gripper

    @property
    def segmenter(self) -> Segmenter:
        """The segmenter tuned for the target, as an operator would have tuned it."""
        return self.target_spec.segmenter

    @property
    def time(self) -> float:
        """Simulated seconds since the episode began."""
        return float(self.data.time)

    @property
    def dynamic(self) -> bool:
        """Whether servos push the joints through time and contacts push back.

        May be set in the middle of an episode: a plan that touches nothing costs a fraction without dynamics, and the
        grasp after it has them.
        """
        return self._dynamic

    @dynamic.setter
    def dynamic(self, dynamic: bool) -> None:
        holder = self._assembly.holder
        if not isinstance(holder, JointedArm):
            raise InvalidParameterError("a floating camera has no dynamics; choose an arm")
        if dynamic != self._dynamic:
            holder.use_dynamics(dynamic)
            self._dynamic = dynamic

    def wait(self, seconds: float) -> None:
        """Let simulated time pass."""
        if not 0 <= seconds < np.inf:
            raise InvalidParameterError(f"a cell waits for a finite time, in s; got {seconds}")
        holder = self._assembly.holder
        if isinstance(holder, JointedArm):
            holder.drive.idle(seconds)
        else:  # a member of the camera for this would be one more that a planner could call
            self.data.time += seconds
            self._watchers()

    @property
    def target_body(self) -> int:
        """The target's body in ``model``."""
        return int(self.model.body(TARGET).id)

    @property
    def finger_geoms(self) -> frozenset[int]:
        """The fingers' geoms in ``model``; empty without a gripper."""
        holder = self._assembly.holder
        gripper = holder.gripper if isinstance(holder, JointedArm) else None
        return frozenset() if gripper is None else gripper.finger_geoms

    def place_camera(self, world_from_camera: RigidTransform) -> None:
        """Stand the arm at once where its camera truly has this pose; for setting up an episode.

        Raises
        ------
        UnreachableError
            No joint angles within the limits and free of collision put the camera there.
        """
        checked_pose(world_from_camera, "world_from_camera")
        holder = self._assembly.holder
        if not isinstance(holder, JointedArm):
            holder.stand_at(world_from_camera)
            return

        def free(q: NDArray[np.float64]) -> bool:
            holder.drive.put(q)
            return not holder.bodies.touching(self.data)

        assert self.arm_spec is not None
        before = holder.drive.joints()
        q = holder.kinematics.solve_any(world_from_camera, self.arm_spec.home, accept=free)
        if q is None:
            holder.drive.put(before)
            where = np.round(world_from_camera.translation, 3).tolist()
            raise UnreachableError(
                f"the camera cannot stand at {where} m (base frame) with that orientation: no joint angles within the "
                "limits and free of collision put it there; try a pose nearer to the workspace "
                f"{self.stage.workspace}, a smaller tilt, or another roll"
            )
        holder.arm.stand_at(q)

    # --- looking at it --------------------------------------------------------------------------------------

    def overview(self, width: int = 960, height: int = 720) -> NDArray[np.uint8]:
        """The whole cell from the front, RGB, shape (height, width, 3), with shadows and smooth edges."""
        if self._overview is None or (self._overview.width, self._overview.height) != (width, height):
            if self._overview is not None:
                self._overview.close()
            self._overview = renderer(self.model, width, height, shadows=True, samples=4)
        self._overview.update_scene(self.data, OVERVIEW)
        return self._overview.render()

    @contextmanager
    def watch(self, callback: Callable[[], None], *, every_step: bool = False) -> Iterator[None]:
        """While in this context, call ``callback()`` at each waypoint of each motion, with ``data`` current.

        Parameters
        ----------
        callback
            Takes nothing.
        every_step
            Whether to call it after every millisecond of the dynamic mode instead.
        """
        callbacks = self._watchers.of_steps if every_step else self._watchers.callbacks
        callbacks.append(callback)
        try:
            yield
        finally:
            callbacks.remove(callback)

    def close(self) -> None:
        """Free the graphics contexts. The cell stays usable; the next picture makes new ones."""
        self._assembly.close_camera()
        if self._overview is not None:
            self._overview.close()
            self._overview = None

    # --- inside ---------------------------------------------------------------------------------------------

    def _build(self, placed: Placed) -> None:
        """Compile the scene and everything that holds on to it."""
        if self._supports >= 0:
            self.close()
        objects = list(zip(self._names(), [self.target_spec, *self._layout.others], strict=True))
        scene = build_scene(self.arm_spec, objects, placed.supports, self.stage, highlights=self._highlights)
        self._assembly = assemble(
            scene.compile(), self.arm_spec, self._watchers, dynamic=self._dynamic, shadows=self._shadows
        )
        self.model, self.data = self._assembly.model, self._assembly.data
        self._supports = len(placed.supports)
        holder = self._assembly.holder
        self.arm = holder.arm if isinstance(holder, JointedArm) else holder

    def _names(self) -> list[str]:
        return [TARGET, *(f"other_{i}" for i in range(len(self._layout.others)))]

    def _put_object(self, name: str, world_from_object: RigidTransform) -> None:
        at = self.model.joint(name).qposadr[0]
        self.data.qpos[at : at + 3] = world_from_object.translation
        self.data.qpos[at + 3 : at + 7] = world_from_object.rotation.as_quat(scalar_first=True)


def _known_arm(arm: str | ArmSpec) -> ArmSpec:
    """The spec of an arm that is not a floating camera; the error names that one too."""
    if isinstance(arm, str) and arm not in ARMS:
        raise UnknownNameError("arm", arm, [*ARMS, FLOATING])
    return arm_spec(arm)


def _seed_sequence(seed: int | np.random.SeedSequence) -> np.random.SeedSequence:
    """A fresh sequence, whose children are the same every time."""
    if isinstance(seed, np.random.SeedSequence):
        return np.random.SeedSequence(seed.entropy, spawn_key=seed.spawn_key)
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise InvalidParameterError(f"a seed is a whole number, 0 or more, or a SeedSequence; got {seed!r}")
    return np.random.SeedSequence(int(seed))
