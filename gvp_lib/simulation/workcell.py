"""The work cell: an arm, an object on a table, and the ground truth about both. Thesis 1.2, 3.1.1; Fig. 3.1."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from typing import Generic, Protocol, TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError, ModelError, UnknownNameError, UnreachableError
from gvp_lib.motion.arm import EyeInHandArm, Gripper
from gvp_lib.perception.segmentation import Segmenter
from gvp_lib.picture import Pictured
from gvp_lib.simulation.arms import ARMS, ArmSpec, arm_spec
from gvp_lib.simulation.camera import CameraSensor, renderer
from gvp_lib.simulation.drives import DynamicDrive, KinematicDrive
from gvp_lib.simulation.kinematics import InverseKinematics
from gvp_lib.simulation.objects import ObjectSpec, object_spec
from gvp_lib.simulation.placements import Layout
from gvp_lib.simulation.robot import FloatingCamera, SimulatedArm, SimulatedGripper
from gvp_lib.simulation.scene import (
    ARM_PREFIX,
    FLOATING,
    OVERVIEW,
    TARGET,
    Stage,
    aim_overview,
    build_scene,
    move_free,
    move_support,
)
from gvp_lib.simulation.sensors import EpisodeNoise, Noise
from gvp_lib.simulation.truth import Truth

__all__ = ["CellCache", "WorkCell"]


@checked
class WorkCell(Pictured):
    """Simulated work cell: one arm and one object to grasp.

    The cell knows nothing of your planner and your segmenter: pass them what the arm gives, as in
    ``my_segmenter(cell.arm.capture())``. ``cell.segmenter`` is one already tuned for the target.

    Parameters
    ----------
    arm
        ``"baxter"``, ``"ur5e"``, ``"floating"`` (a camera without an arm), or an :class:`ArmSpec` of your own.
    target
        Object to grasp: a name in ``OBJECTS``, or an :class:`ObjectSpec` of your own.
    placement
        ``"flat"``: on the table; ``"raised"``: level on a block; ``"side"``: lying on a side face; ``"tilted"``:
        leaning on a block, 15 to 30 deg off the vertical, or ``"steep"``, 30 to 45; ``"ramp"``: on a ramp of 30 to 45
        deg; ``"walled"``: on the table, one long side hidden by a block.
    noise
        Imperfections of arm and sensors; none by default.
    seed
        Seed of everything random: the object's position and yaw, and the noise. The same seed gives the same cell, to
        the last bit of every image.
    others
        More objects, flat on the table around the target.
    touching
        Whether the others stand so close that they touch the target, or its block, and may hide a part of it; otherwise
        clear of it.
    dynamic
        Whether servos move the joints under physics and contacts push back. Otherwise (kinematic mode) the arm jumps
        from waypoint to waypoint and objects stay where they are, which is far faster.
    shadows, highlights
        Whether the lamp casts shadows (an image then takes six times as long without a GPU), and whether surfaces have
        specular highlights.

    Attributes
    ----------
    arm
        Arm with the camera in its hand. A planner may see this and ``gripper``, nothing else.
    truth
        Ground truth, by which a planner is judged and which it may not see.
    arm_spec, target_spec
        Specs of the arm (None for a floating camera) and of the target.
    stage
        Table, floor and workspace.
    model, data
        MuJoCo scene, to draw or inspect.
    seed
        Seed of the current episode.
    noise
        Imperfections, drawn anew at each ``reset``.

    Raises
    ------
    UnknownNameError
        There is no arm, object or placement of that name.
    ModelError
        The model of the arm or of an object lacks something, such as servos where ``dynamic`` is set.
    InvalidParameterError
        ``dynamic`` is set for a floating camera, or an argument is of the wrong kind.
    GvpError
        An object does not come to rest as placed.

    Notes
    -----
    :meth:`overview` renders the whole cell. Take all images of a cell from one thread. Its graphics contexts hold some
    100 MB: of many cells, use each in a ``with`` statement, or :meth:`close` it.

    Examples
    --------
    >>> cell = WorkCell(arm="ur5e", target="cuboid_1x2", placement="tilted", noise=Noise.thesis(), seed=7)
    >>> cell
    WorkCell(ur5e, cuboid_1x2 tilted, noise thesis, kinematic, seed 7)
    >>> cell.arm
    SimulatedArm(ur5e, 6 joints, 640 x 480 camera)
    >>> cell.arm.capture().shape
    (480, 640, 3)
    """

    _figure = "plot_work_cell"

    arm: EyeInHandArm
    truth: Truth
    model: mujoco.MjModel
    data: mujoco.MjData
    seed: int | np.random.SeedSequence

    def __init__(
        self,
        arm: str | ArmSpec = "baxter",
        target: str | ObjectSpec = "cuboid_1x2",
        placement: str = "flat",
        *,
        noise: Noise | None = None,
        seed: int | np.random.SeedSequence = 0,
        others: Sequence[str | ObjectSpec] = (),
        touching: bool = False,
        dynamic: bool = False,
        shadows: bool = False,
        highlights: bool = False,
    ) -> None:
        if isinstance(arm, str) and arm not in (*ARMS, FLOATING):
            raise UnknownNameError("arm", arm, [*ARMS, FLOATING])
        self.arm_spec = spec = None if arm == FLOATING else arm_spec(arm)
        self.target_spec = object_spec(target)
        if not isinstance(noise, Noise | None):
            raise InvalidParameterError(f"noise is a Noise, such as Noise.thesis(), or None; got {noise!r}")
        if dynamic and spec is None:
            raise InvalidParameterError("a floating camera has no dynamics; choose an arm, or dynamic=False")
        self.noise = noise or Noise.none()
        self._dynamic, self._waypoints, self._steps = dynamic, _Callbacks(), _Callbacks()
        self._overview: mujoco.Renderer | None = None

        self.stage = Stage(spec.table_height, spec.floor_height, spec.workspace) if spec else Stage()
        self._layout = Layout(self.target_spec, placement, others, self.stage, touching=touching)
        self._names = [TARGET, *(f"other_{i}" for i in range(len(self._layout.others)))]
        placed, _ = self._layout.at_rest(_seeds(seed)[0])  # with as many blocks as in every episode
        objects = list(zip(self._names, [self.target_spec, *self._layout.others], strict=True))
        scene = build_scene(spec, objects, placed.supports, self.stage, highlights=highlights)
        self._scene, self.model = scene, scene.compile()
        self.data = mujoco.MjData(self.model)
        # No more than poses: the objects are not in their places yet, but one in the other.
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        self._camera = self.model.camera(ARM_PREFIX + spec.camera if spec else FLOATING).id
        self.truth = Truth(self.data, self.target_body, self._camera, self.target_spec.accepted_normal)

        self._eye: FloatingCamera | SimulatedArm
        self._gripper: SimulatedGripper | None = None
        if spec is None:
            self._eye = FloatingCamera(self.model, self.data, shadows=shadows, on_waypoint=self._waypoints)
        else:
            sensor = CameraSensor(self.model, self.data, self._camera, *spec.image_size, shadows=shadows)
            self._home, self._kinematics = spec.home, InverseKinematics(spec)
            self._drive = self._new_drive(spec, dynamic)
            self._eye = SimulatedArm(self._kinematics, self._drive, sensor)
            if spec.gripper is not None:
                self._gripper = SimulatedGripper(self.model, self.data, spec.gripper, spec.camera, self._drive)
        self.arm = self._eye
        self.reset(seed)

    def __repr__(self) -> str:
        arm = self.arm_spec.name if self.arm_spec else FLOATING
        count = len(self._layout.others)
        others = f" + {count} other{'s' * (count > 1)}" if count else ""
        noise = {Noise.none(): "none", Noise.thesis(): "thesis"}.get(self.noise, "custom")
        mode = "dynamic" if self.dynamic else "kinematic"
        seed = f", seed {self.seed}" if not isinstance(self.seed, np.random.SeedSequence) else ""
        return f"WorkCell({arm}, {self.target_spec.name} {self.placement}{others}, noise {noise}, {mode}{seed})"

    @property
    def placement(self) -> str:
        """Placement of the target."""
        return self._layout.placement

    def _new_drive(self, spec: ArmSpec, dynamic: bool) -> KinematicDrive:
        if dynamic:
            return DynamicDrive(self.model, self.data, spec, self._waypoints, self._steps)
        return KinematicDrive(self.model, self.data, spec, self._waypoints)

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
        """Begin an episode: place the objects, draw the noise, send the arm home and set the clock to zero.

        Parameters
        ----------
        seed
            As in the constructor; None repeats the current episode.
        noise_seed
            Seed of the noise alone, for another episode with the objects where they were; None derives it from
            ``seed``.
        """
        seed = self.seed if seed is None else seed
        for_places, for_noise = _seeds(seed)
        self.seed = seed
        placed, beside = self._layout.at_rest(for_places)
        mujoco.mj_resetData(self.model, self.data)
        for i, support in enumerate(placed.supports):
            move_support(self.model, self.data, i, support)
        for name, where in zip(self._names, [placed, *beside], strict=True):
            move_free(self.model, self.data, name, where.world_from_object)
        joints = len(self.arm_spec.joints) if self.arm_spec else 0
        self._noise = EpisodeNoise(self.noise, joints, noise_seed or for_noise)
        self._eye.begin_episode(self._noise)
        if isinstance(self._eye, SimulatedArm):
            self._eye.stand_at(self._home + self._noise.joint_offset)  # where the encoders read home
        if self._gripper is not None:
            self._gripper.begin_episode(self._noise)
        mujoco.mj_forward(self.model, self.data)
        aim_overview(self.model, self.data, self.stage)
        mujoco.mj_camlight(self.model, self.data)
        self.truth.begin_episode()

    @property
    def gripper(self) -> Gripper:
        """Gripper of the arm, with the range sensor in its palm; a ModelError where the arm has none."""
        if self._gripper is None:
            name = self.arm_spec.name if self.arm_spec else FLOATING
            having = [spec.name for spec in ARMS.values() if spec.gripper is not None]
            raise ModelError(f"arm {name!r} has no gripper; of the known arms, {', '.join(having)} has one")
        return self._gripper

    @property
    def segmenter(self) -> Segmenter:
        """Segmenter tuned for the target, as an operator would have done."""
        return self.target_spec.segmenter

    @property
    def time(self) -> float:
        """Simulated time since the start of the episode, s."""
        return float(self.data.time)

    @property
    def dynamic(self) -> bool:
        """Whether servos and contacts act. May be set within an episode, since planning is far faster without them."""
        return self._dynamic

    @dynamic.setter
    def dynamic(self, dynamic: bool) -> None:
        if self.arm_spec is None or isinstance(self._eye, FloatingCamera):
            raise InvalidParameterError("a floating camera has no dynamics; choose an arm")
        if dynamic != self._dynamic:
            self._drive, self._dynamic = self._new_drive(self.arm_spec, dynamic), dynamic
            self._eye.move_by(self._drive)
            if self._gripper is not None:
                self._gripper.move_by(self._drive)
            self._drive.put(self._drive.joints())

    def wait(self, seconds: float) -> None:
        """Let simulated time pass while the arm stands still.

        Parameters
        ----------
        seconds
            Time to pass, s.
        """
        if not 0 <= seconds < np.inf:
            raise InvalidParameterError(f"a cell waits for a finite time, in s; got {seconds}")
        if isinstance(self._eye, FloatingCamera):  # a method of the camera would be one that a planner could call
            self.data.time += seconds
            self._waypoints()
        else:
            self._drive.idle(seconds)

    @property
    def target_body(self) -> int:
        """Id of the target's body in ``model``."""
        return int(self.model.body(TARGET).id)

    @property
    def finger_geoms(self) -> frozenset[int]:
        """Ids of the fingers' geoms in ``model``; empty without a gripper."""
        return frozenset() if self._gripper is None else self._gripper.finger_geoms

    def place_camera(self, world_from_camera: RigidTransform) -> None:
        """Set up an episode: put the arm at once where its camera truly has this pose.

        Parameters
        ----------
        world_from_camera
            True pose of the optical frame.

        Raises
        ------
        UnreachableError
            No joint angles within the limits and free of collision put the camera there.
        """
        if isinstance(self._eye, FloatingCamera):
            self._eye.stand_at(world_from_camera)
            return

        def free(q: NDArray[np.float64]) -> bool:
            self._drive.put(q)
            return not len(self._drive.contacts())

        before = self._drive.joints()
        q = self._kinematics.solve_any(world_from_camera, self._home, accept=free)
        if q is None:
            self._drive.put(before)
            where = np.round(world_from_camera.translation, 3).tolist()
            raise UnreachableError(
                f"the camera cannot stand at {where} m (base frame) with that orientation: no joint angles within the "
                "limits and free of collision put it there; try a pose nearer to the workspace "
                f"{self.stage.workspace}, a smaller tilt, or another roll"
            )
        self._eye.stand_at(q)

    def as_text(self) -> str:
        """MJCF of the cell as it was built, without its textures.

        It rounds to six digits, and has blocks under objects where the first episode had them: what the arrays of
        ``model`` say goes before.
        """
        scene = self._scene.copy()
        for material in scene.materials:
            material.textures = [""] * len(material.textures)
        for texture in list(scene.textures):
            scene.delete(texture)
        scene.compile()
        return str(scene.to_xml())

    # --- looking at it --------------------------------------------------------------------------------------

    def overview(self, width: int = 960, height: int = 720) -> NDArray[np.uint8]:
        """Render the whole cell from the front: RGB, shape (height, width, 3), with shadows and antialiasing.

        Parameters
        ----------
        width, height
            Size of the image, pixels, at most 4096 each.
        """
        if self._overview is not None and (self._overview.width, self._overview.height) != (width, height):
            self._overview.close()
            self._overview = None
        if self._overview is None:
            self._overview = renderer(self.model, width, height, shadows=True, samples=4)
        self._overview.update_scene(self.data, OVERVIEW)
        return self._overview.render()

    @contextmanager
    def watch(self, callback: Callable[[], None], *, every_step: bool = False) -> Iterator[None]:
        """Call a function at each waypoint of each motion, with ``data`` up to date, while in this context.

        Parameters
        ----------
        callback
            Function to call, without arguments.
        every_step
            Whether to call it after every step of the physics (1 ms) instead, in the dynamic mode.
        """
        callbacks = self._steps if every_step else self._waypoints
        callbacks.append(callback)
        try:
            yield
        finally:
            callbacks.remove(callback)

    def close(self) -> None:
        """Free the graphics contexts. The cell stays usable: the next image makes new ones."""
        self._eye.close()
        if self._overview is not None:
            self._overview.close()
            self._overview = None


class _Callbacks(list[Callable[[], None]]):
    """Functions to call one after the other; not part of the cell, so that a drive needn't know it."""

    def __call__(self) -> None:
        for callback in list(self):
            callback()


class _Closable(Protocol):
    def close(self) -> None: ...


T = TypeVar("T", bound=_Closable)


@checked
class CellCache(Generic[T]):
    """Cache of one cell, or of whatever holds one, for consecutive jobs on the same kind of cell.

    A cell's graphics context takes some 100 MB, so it is closed as soon as another replaces it rather than left to the
    garbage collector.

    Examples
    --------
    >>> cache = CellCache[WorkCell]()
    >>> cell = cache.get("flat", lambda: WorkCell("floating"))
    >>> cache.get("flat", lambda: WorkCell("floating")) is cell
    True
    """

    def __init__(self) -> None:
        self._last: tuple[Hashable, T] | None = None

    def __repr__(self) -> str:
        return f"CellCache({type(self._last[1]).__name__ if self._last else 'empty'})"

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return the cached cell if it was made under the same key; otherwise make one and cache it.

        Parameters
        ----------
        key
            Key of the wanted cell.
        make
            Function that makes it.
        """
        if self._last is None or self._last[0] != key:
            if self._last is not None:
                self._last[1].close()
                self._last = None  # should making the next one fail
            self._last = key, make()
        return self._last[1]


def _seeds(seed: int | np.random.SeedSequence) -> list[np.random.SeedSequence]:
    """Seeds of the places and of the noise, the same every time."""
    if isinstance(seed, np.random.SeedSequence):  # a copy, which has not spawned yet
        return np.random.SeedSequence(seed.entropy, spawn_key=seed.spawn_key).spawn(2)
    return np.random.SeedSequence(seed).spawn(2)
