"""Joint angles and camera poses: inverse kinematics through mink, collisions, and a home for an arm that has none."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace

import mink
import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError, ModelError, UnreachableError
from gvp_lib.simulation.arms import ArmSpec
from gvp_lib.simulation.camera import optical_pose
from gvp_lib.simulation.scene import ARM_PREFIX, Stage, build_scene

__all__ = ["PACE", "ArmBodies", "InverseKinematics", "looking_down"]

Accept = Callable[[NDArray[np.float64]], bool]

POSITION_TOLERANCE = 1e-4  # m
ANGLE_TOLERANCE = np.radians(0.05)  # rad
_EXACT = 1e-6  # m and rad together: nothing is gained beyond it
_CHEAP = 1e-3  # weight of a unit cost against the pose's: it decides between ways to reach a pose, and nothing else
_MAX_STEP = 0.6  # rad, of any joint in one iteration: beyond it the linearization is worth little
_SEEDS = 8  # searches, of which the best answer counts
_RESTARTS = 60
_WINDING = 0.03  # m of height that a radian of the most turned joint is worth

PACE = 0.25
"""Share of the joints' speed limits at which an arm beside people works: its hand then moves some 0.25 m/s."""


class InverseKinematics:
    """Inverse and forward kinematics of a camera in a hand, within the joint limits.

    Nothing here knows about collisions; ``accept`` lets a caller refuse a solution for any reason.

    Parameters
    ----------
    model
        Compiled arm, best from :meth:`gvp_lib.simulation.arms.ArmSpec.kinematic_model`. Its world frame is the base
        frame of every pose here.
    camera
        Name of the camera.
    joints
        Names of the joints that may move. All others stay as the model has them at rest.
    costs
        Cost of moving each of them by 1 rad or 1 m; squares add up. None where all cost the same. It matters only to an
        arm with more joints than it needs.
    """

    def __init__(
        self, model: mujoco.MjModel, camera: str, joints: Sequence[str], costs: Sequence[float] | None = None
    ) -> None:
        self._camera = _id(model, mujoco.mjtObj.mjOBJ_CAMERA, "camera", camera)
        ids = np.array([_id(model, mujoco.mjtObj.mjOBJ_JOINT, "joint", name) for name in joints])
        self._model = model
        self._qpos = model.jnt_qposadr[ids]
        self._turns = model.jnt_type[ids] == int(mujoco.mjtJoint.mjJNT_HINGE)
        limited = model.jnt_limited[ids].astype(bool)
        self._low = np.where(limited, model.jnt_range[ids, 0], -np.inf)
        self._high = np.where(limited, model.jnt_range[ids, 1], np.inf)

        body = int(model.cam_bodyid[self._camera])
        rotation = Rotation.from_quat(model.cam_quat[self._camera], scalar_first=True).as_matrix()
        # Matrices inside: SciPy's RigidTransform costs more per product than a step of the solver.
        self._body_from_camera = optical_pose(model.cam_pos[self._camera], rotation).as_matrix()  # (4, 4)
        self._camera_from_body = np.linalg.inv(self._body_from_camera)
        x, y, z = model.cam_pos[self._camera]
        self._lever = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # _lever @ angle = angle x position
        self._body = body
        # The body that carries the camera is as good a frame as the camera: they move as one.
        self._task = mink.FrameTask(model.body(body).name, "body", position_cost=1.0, orientation_cost=1.0)
        self._tasks: list[mink.Task] = [self._task]
        if costs is not None:
            damping = np.zeros(model.nv)
            damping[model.jnt_dofadr[ids]] = _CHEAP * np.asarray(costs, float)
            self._tasks.append(mink.DampingTask(model, damping))
        self._limits = [mink.ConfigurationLimit(model, gain=1.0)]
        self._configuration = mink.Configuration(model)
        # An arm that stands is asked for its pose again and again, and making a RigidTransform takes its time.
        self._last_forward = np.full(len(ids), np.nan), RigidTransform.identity()
        others = sorted(set(range(model.nv)) - set(model.jnt_dofadr[ids].tolist()))
        moving = _dofs_of_chain(model, body)
        self._frozen = [mink.DofFreezingTask(model, stray)] if (stray := [d for d in others if d in moving]) else None

    @property
    def limits(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper joint limits, each of shape (n,), rad; infinite where a joint has none."""
        return self._low.copy(), self._high.copy()

    def forward(self, q: ArrayLike) -> RigidTransform:
        """``base_from_camera``, of the optical frame, at joint angles ``q``, shape (n,), rad."""
        q = self._checked(q)
        known_q, known = self._last_forward
        if not np.array_equal(q, known_q):
            self._configuration.update(self._full(q))
            data = self._configuration.data
            base_from_body = np.eye(4)
            base_from_body[:3, :3], base_from_body[:3, 3] = data.xmat[self._body].reshape(3, 3), data.xpos[self._body]
            known = RigidTransform.from_matrix(base_from_body @ self._body_from_camera)
            self._last_forward = q.copy(), known
        return known

    def solve(
        self, base_from_camera: RigidTransform, q0: ArrayLike, max_iterations: int = 30
    ) -> NDArray[np.float64] | None:
        """Joint angles nearest ``q0`` downhill, or None where the descent does not reach the pose.

        Parameters
        ----------
        base_from_camera
            Wanted pose of the camera's optical frame.
        q0
            Joint angles to start from, shape (n,), rad; clipped to the limits.
        max_iterations
            Limit on the iterations; a pose a few centimeters away takes three.

        Returns
        -------
        ndarray or None
            Shape (n,), within the limits, and within 0.1 mm and 0.05 deg of the pose.
        """
        q = np.clip(self._checked(q0), self._low, self._high)
        target = base_from_camera.as_matrix() @ self._camera_from_body
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, target[:3, :3].ravel())
        self._task.set_target(mink.SE3(np.concatenate([quaternion, target[:3, 3]])))
        configuration = self._configuration
        configuration.update(self._full(q))
        best, stalled = np.inf, 0
        found: NDArray[np.float64] | None = None
        for _ in range(max_iterations + 1):
            error = self._task.compute_error(configuration)  # (6,): m, rad
            norm = float(np.linalg.norm(error))
            if self._close(error) and norm < best:
                # Good enough; but a step smaller than the tolerance must not end where it began.
                found = np.clip(configuration.data.qpos[self._qpos], self._low, self._high)
                if norm < _EXACT:
                    return found
            stalled = stalled + 1 if norm > 0.98 * best else 0
            best = min(best, norm)
            if stalled > (2 if found is not None else 8):
                break
            try:
                step = mink.solve_ik(
                    configuration, self._tasks, 1.0, "daqp", 1e-8, limits=self._limits, constraints=self._frozen
                )
            except mink.NoSolutionFound:
                break
            step *= min(1.0, _MAX_STEP / max(float(np.abs(step).max()), 1e-12))
            configuration.integrate_inplace(step, 1.0)
        return found

    def solve_any(
        self,
        base_from_camera: RigidTransform,
        q0: ArrayLike,
        rng: np.random.Generator | int = 0,
        restarts: int = 40,
        accept: Accept | None = None,
    ) -> NDArray[np.float64] | None:
        """Joint angles for a pose, tried from ``q0`` first, then from random starts ever further from it.

        Parameters
        ----------
        base_from_camera, q0
            As in :meth:`solve`.
        rng
            Generator, or a seed: the same seed gives the same answer.
        restarts
            Random starts before the pose is given up.
        accept
            Judge of each solution; the first for which it returns true is the answer. None takes any.

        Returns
        -------
        ndarray or None
            As in :meth:`solve`. Every joint that can turn more than once is within half a turn of ``q0``
            where its limits allow.
        """
        rng = np.random.default_rng(rng)
        q0 = np.clip(self._checked(q0), self._low, self._high)
        low, high = np.maximum(self._low, q0 - np.pi), np.minimum(self._high, q0 + np.pi)
        for attempt in range(restarts + 1):
            spread = attempt / max(restarts, 1)
            start = q0 + min(1.0, 2 * spread) * (rng.uniform(low, high) - q0) if attempt else q0
            q = self.solve(base_from_camera, start, max_iterations=60)
            if q is None:
                continue
            q = self._unwound(q, q0)
            if accept is None or accept(q):
                return q
        return None

    def _unwound(self, q: NDArray[np.float64], q0: NDArray[np.float64]) -> NDArray[np.float64]:
        """The same pose less whole turns, as near ``q0`` as the limits allow."""
        turns = np.where(self._turns, 2 * np.pi * np.round((q0 - q) / (2 * np.pi)), 0.0)
        inside = (q + turns >= self._low) & (q + turns <= self._high)
        return np.where(inside, q + turns, q)

    def _close(self, error: NDArray[np.float64]) -> bool:
        # The body's error, moved to the camera, which stands off the body's origin.
        angle = error[3:]
        shift = error[:3] + self._lever @ angle
        return bool(shift @ shift < POSITION_TOLERANCE**2 and angle @ angle < ANGLE_TOLERANCE**2)

    def _full(self, q: NDArray[np.float64]) -> NDArray[np.float64]:
        full = self._model.qpos0.copy()
        full[self._qpos] = q
        return full

    def _checked(self, q: ArrayLike) -> NDArray[np.float64]:
        q = np.asarray(q, float)
        if q.shape != self._low.shape or not np.isfinite(q).all():
            raise InvalidParameterError(f"joint angles are {self._low.size} finite numbers, in rad; got {q!r}")
        return q


class ArmBodies:
    """The joints of a scene that are the arm's, and the geoms that they move.

    Attributes
    ----------
    joints, qpos, dofs
        Ids of the joints, and their places in ``data.qpos`` and ``data.qvel``, each of shape (n,).
    speeds
        Speed limits, shape (n,), rad/s.
    geoms
        Mask of the geoms that the joints move, bool (ngeom,).
    """

    def __init__(self, model: mujoco.MjModel, arm: ArmSpec) -> None:
        ids = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, ARM_PREFIX + name) for name in arm.joints]
        self.joints = np.array(ids)
        self.qpos = model.jnt_qposadr[self.joints]
        self.dofs = model.jnt_dofadr[self.joints]
        self.speeds = np.broadcast_to(np.asarray(arm.joint_speed, float), len(arm.joints))
        # Only what the joints carry: the rest of a model, a pedestal or a puck on a slide, stands where it stands
        # whatever the arm does, and what it touches is no collision of the arm.
        carried = np.zeros(model.nbody, bool)
        carried[model.jnt_bodyid[self.joints]] = True
        for body in range(1, model.nbody):  # parents come before their children
            carried[body] |= carried[model.body_parentid[body]]
        self.geoms = carried[model.geom_bodyid]

    def put(self, model: mujoco.MjModel, data: mujoco.MjData, q: NDArray[np.float64]) -> None:
        """Set the joints, at rest, and bring everything that follows from them up to date."""
        data.qpos[self.qpos] = q
        data.qvel[:] = 0
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_camlight(model, data)
        mujoco.mj_collision(model, data)

    def touching(self, data: mujoco.MjData) -> bool:
        """Whether anything that the joints move is in contact, with the arm itself or with anything else."""
        contact = data.contact
        return bool(data.ncon and (self.geoms[contact.geom].any(axis=1) & (contact.dist < 0)).any())

    def seconds(self, a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
        """Time between two configurations at the arm's working pace, s."""
        return float(np.max(np.abs(b - a) / (PACE * self.speeds)))


def looking_down(arm: ArmSpec, height: float = 0.35) -> ArmSpec:
    """The same arm, with a home solved for: its camera looks straight down on the middle of the workspace.

    For an arm whose home you don't know. Far from the base is up in the image. Of the solutions clear of the table and
    of the arm itself, it is the one that carries the links high, elbow up, without turning a joint far from where the
    search begins.

    Parameters
    ----------
    arm
        Your arm; the search begins at its present home, which may be all zeros.
    height
        Height of the camera above the table, m.

    Raises
    ------
    UnreachableError
        No joint angles within the limits and free of collision were found.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from gvp_lib import ARMS
    >>> lost = replace(ARMS["ur5e"], home=(0.0,) * 6)
    >>> looking_down(lost).home != lost.home
    True
    """
    stage = Stage(arm.table_height, arm.floor_height, arm.workspace)
    middle = np.mean(arm.workspace, axis=1)
    away = middle / np.linalg.norm(middle) if np.linalg.norm(middle) > 1e-6 else np.array([1.0, 0.0])
    rotation = Rotation.from_matrix([[away[1], -away[0], 0], [-away[0], -away[1], 0], [0, 0, -1.0]])
    goal = RigidTransform.from_components([*middle, arm.table_height + height], rotation)

    model = build_scene(arm, [], [], stage).compile()
    data, kinematics = mujoco.MjData(model), InverseKinematics(arm.kinematic_model(), arm.camera, arm.joints)
    bodies = ArmBodies(model, arm)
    links = np.unique(model.geom_bodyid[bodies.geoms])

    touched: Counter[str] = Counter()

    def free(q: NDArray[np.float64]) -> bool:
        bodies.put(model, data, q)
        touched.update(_touching(model, data, bodies))
        return not bodies.touching(data)

    found = []
    for seed in range(_SEEDS):
        q = kinematics.solve_any(goal, arm.home, seed, restarts=_RESTARTS, accept=free)
        if q is not None:
            bodies.put(model, data, q)
            far = np.abs(q - np.asarray(arm.home)).max()
            found.append((float(data.xipos[links, 2].mean()) - _WINDING * far, q))
    if not found:
        raise _no_home(arm, height, goal, touched)
    return replace(arm, home=tuple(float(angle) for angle in max(found, key=lambda item: item[0])[1]))


def _no_home(arm: ArmSpec, height: float, goal: RigidTransform, touched: Counter[str]) -> UnreachableError:
    """The error that says why: what got in the way most often, or that nothing within the limits reaches there."""
    where = f"{height} m above the middle of the workspace, {np.round(goal.translation, 3).tolist()} m (base frame)"
    if touched:
        return UnreachableError(
            f"arm {arm.name!r}: with the camera {where}, {touched.most_common(1)[0][0]}. If they overlap "
            "wherever the arm stands, make them smaller, or add <contact><exclude body1= body2=></contact>: MuJoCo "
            "lets a link overlap the one that carries it, but not a base that stands still"
        )
    return UnreachableError(
        f"arm {arm.name!r}: no joint angles within its limits put the camera {where}. Try another height, a "
        "workspace nearer to the base, or turn camera_mount: z looks out of the lens"
    )


def _touching(model: mujoco.MjModel, data: mujoco.MjData, bodies: ArmBodies) -> set[str]:
    """Contacts of the bodies that the joints move, in words."""
    contacts = data.contact
    pairs = contacts.geom[bodies.geoms[contacts.geom].any(axis=1) & (contacts.dist < 0)] if data.ncon else []
    names = [
        sorted(model.body(model.geom_bodyid[geom]).name.removeprefix(ARM_PREFIX) for geom in pair) for pair in pairs
    ]
    return {f"{a!r} touches {b!r}" for a, b in names}


def _id(model: mujoco.MjModel, kind: mujoco.mjtObj, word: str, name: str) -> int:
    found = mujoco.mj_name2id(model, kind, name)
    if found < 0:
        count = {"camera": model.ncam, "joint": model.njnt}[word]
        known = ", ".join(mujoco.mj_id2name(model, kind, i) or "" for i in range(count)) or "none"
        raise ModelError(f"the model has no {word} {name!r}. It has: {known}")
    return int(found)


def _dofs_of_chain(model: mujoco.MjModel, body: int) -> set[int]:
    """Indices of the degrees of freedom that move a body."""
    dofs: set[int] = set()
    while body:
        first, count = model.body_dofadr[body], model.body_dofnum[body]
        dofs.update(range(first, first + count))
        body = int(model.body_parentid[body])
    return dofs
