"""Inverse kinematics of a camera in a hand, through mink, and a home for an arm that has none."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import mink
import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError, UnreachableError
from gvp_lib.simulation.arms import ArmSpec
from gvp_lib.simulation.base import BASE_JOINTS
from gvp_lib.simulation.camera import optical_pose
from gvp_lib.simulation.drives import KinematicDrive
from gvp_lib.simulation.scene import ARM_PREFIX, Stage, build_scene

__all__ = ["InverseKinematics", "looking_down"]

_POSITION_TOLERANCE = 1e-4  # m
_ANGLE_TOLERANCE = np.radians(0.05)  # rad
_EXACT = 1e-6  # m and rad together: nothing is gained beyond it
_CHEAP = 1e-3  # weight of a unit cost against the pose's: it decides between ways to reach a pose, and nothing else
_MAX_STEP = 0.6  # rad, of any joint in one iteration: beyond it the linearization is worth little
_SEEDS = 8  # searches, of which the best answer counts
_RESTARTS = 60
_WINDING = 0.03  # m of height that a radian of the most turned joint is worth


class InverseKinematics:
    """Inverse and forward kinematics of the camera in an arm's hand, within the joint limits.

    Nothing here knows about collisions; ``accept`` lets a caller refuse a solution for any reason. Joints that the arm
    does not name stay as its model has them at rest. An arm on a base does what it can, and the base, whose moves cost
    more, the rest.

    Parameters
    ----------
    arm
        Arm; its base frame is that of every pose here.
    """

    def __init__(self, arm: ArmSpec) -> None:
        spec = arm.load()
        for equality in list(spec.equalities):  # constraints between joints are not for the solver
            spec.delete(equality)
        self._model = model = spec.compile()
        ids = np.array([model.joint(name).id for name in arm.joints])
        dofs = model.jnt_dofadr[ids]
        self._qpos = model.jnt_qposadr[ids]
        self._turns = model.jnt_type[ids] == int(mujoco.mjtJoint.mjJNT_HINGE)
        limited = model.jnt_limited[ids].astype(bool)
        self._low = np.where(limited, model.jnt_range[ids, 0], -np.inf)
        self._high = np.where(limited, model.jnt_range[ids, 1], np.inf)

        camera = model.camera(arm.camera)
        rotation = Rotation.from_quat(camera.quat, scalar_first=True).as_matrix()
        # Matrices inside: SciPy's RigidTransform costs more per product than a step of the solver.
        self._body_from_camera = optical_pose(camera.pos, rotation).as_matrix()  # (4, 4)
        self._camera_from_body = np.linalg.inv(self._body_from_camera)
        x, y, z = camera.pos
        self._lever = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # _lever @ angle = angle x position
        # The body that carries the camera is as good a frame as the camera: they move as one.
        self._body = int(camera.bodyid[0])
        self._task = mink.FrameTask(self._body, "body", position_cost=1.0, orientation_cost=1.0)
        self._tasks: list[mink.Task] = [self._task]
        if arm.base is not None:
            damping = np.zeros(model.nv)
            damping[dofs] = _CHEAP
            damping[dofs[: len(BASE_JOINTS)]] *= arm.base.cost
            self._tasks.append(mink.DampingTask(model, damping))
        self._limits = [mink.ConfigurationLimit(model, gain=1.0)]
        self._configuration = mink.Configuration(model)
        # An arm that stands is asked for its pose again and again, and making a RigidTransform takes its time.
        self._last_forward = np.full(len(ids), np.nan), RigidTransform.identity()
        moving = np.flatnonzero(self._configuration.get_frame_jacobian(self._body, "body").any(axis=0))
        stray = np.setdiff1d(moving, dofs).tolist()
        self._frozen = [mink.DofFreezingTask(model, stray)] if stray else None

    @property
    def limits(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper joint limits, each of shape (n,), rad; infinite where a joint has none."""
        return self._low.copy(), self._high.copy()

    def forward(self, q: ArrayLike) -> RigidTransform:
        """``base_from_camera``, of the optical frame, at joint angles ``q``, shape (n,), rad."""
        q = self.checked(q)
        known_q, known = self._last_forward
        if not np.array_equal(q, known_q):
            self._put(q)
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
        target = base_from_camera.as_matrix() @ self._camera_from_body
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, target[:3, :3].ravel())
        self._task.set_target(mink.SE3(np.concatenate([quaternion, target[:3, 3]])))
        configuration = self._configuration
        self._put(np.clip(self.checked(q0), self._low, self._high))
        best, stalled, found = np.inf, 0, None
        for _ in range(max_iterations + 1):
            error = self._task.compute_error(configuration)  # (6,): m, rad, at the body
            norm, angle = float(np.linalg.norm(error)), error[3:]
            shift = error[:3] + self._lever @ angle  # at the camera
            close = shift @ shift < _POSITION_TOLERANCE**2 and angle @ angle < _ANGLE_TOLERANCE**2
            if close and norm < best:
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
        accept: Callable[[NDArray[np.float64]], bool] | None = None,
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
        q0 = np.clip(self.checked(q0), self._low, self._high)
        low, high = np.maximum(self._low, q0 - np.pi), np.minimum(self._high, q0 + np.pi)
        for attempt in range(restarts + 1):
            spread = attempt / max(restarts, 1)
            start = q0 + min(1.0, 2 * spread) * (rng.uniform(low, high) - q0) if attempt else q0
            q = self.solve(base_from_camera, start, max_iterations=60)
            if q is None:
                continue
            # The same pose less whole turns, as near q0 as the limits allow.
            unwound = q + np.where(self._turns, 2 * np.pi * np.round((q0 - q) / (2 * np.pi)), 0.0)
            q = np.where((unwound >= self._low) & (unwound <= self._high), unwound, q)
            if accept is None or accept(q):
                return q
        return None

    def _put(self, q: NDArray[np.float64]) -> None:
        full = self._model.qpos0.copy()
        full[self._qpos] = q
        self._configuration.update(full)

    def checked(self, q: ArrayLike) -> NDArray[np.float64]:
        """Joint angles that a caller gave, as an array of shape (n,), or the error that says what they are."""
        q, n = np.asarray(q, float), self._low.size
        if q.shape != (n,) or not np.isfinite(q).all():
            raise InvalidParameterError(f"this arm has {n} joints: q is {n} finite numbers, in rad; got {q!r}")
        return q


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
    middle = np.mean(arm.workspace, axis=1)
    distance = np.linalg.norm(middle)
    x, y = middle / distance if distance > 1e-6 else (1.0, 0.0)
    rotation = Rotation.from_matrix([[y, -x, 0], [-x, -y, 0], [0, 0, -1.0]])
    goal = RigidTransform.from_components([*middle, arm.table_height + height], rotation)

    stage = Stage(arm.table_height, arm.floor_height, arm.workspace)
    model = build_scene(arm, [], [], stage).compile()
    data, kinematics = mujoco.MjData(model), InverseKinematics(arm)
    drive = KinematicDrive(model, data, arm)
    links = np.unique(model.geom_bodyid[drive.geoms])
    touched: Counter[tuple[str, ...]] = Counter()

    def free(q: NDArray[np.float64]) -> bool:
        drive.put(q)
        bodies = model.geom_bodyid[drive.contacts()]  # (k, 2)
        names = {tuple(sorted(model.body(body).name.removeprefix(ARM_PREFIX) for body in pair)) for pair in bodies}
        touched.update(sorted(names))  # the first of the most frequent is then the same in every process
        return not len(bodies)

    def merit(q: NDArray[np.float64]) -> float:
        drive.put(q)
        return float(data.xipos[links, 2].mean() - _WINDING * np.abs(q - arm.home).max())

    found = (kinematics.solve_any(goal, arm.home, seed, _RESTARTS, free) for seed in range(_SEEDS))
    if homes := [q for q in found if q is not None]:
        return replace(arm, home=tuple(max(homes, key=merit).tolist()))
    why = (
        "no joint angles within its limits put it there. Try another height, a workspace nearer to the base, or turn "
        "camera_mount: z looks out of the lens"
    )
    if touched:
        (a, b), _ = touched.most_common(1)[0]
        why = (
            f"{a!r} touches {b!r}. If they overlap wherever the arm stands, make them smaller, or add "
            "<contact><exclude body1= body2=></contact>: MuJoCo lets a link overlap the one that carries it, but not a "
            "base that stands still"
        )
    raise UnreachableError(
        f"arm {arm.name!r}: with the camera {height} m above the middle of the workspace, "
        f"{np.round(goal.translation, 3).tolist()} m (base frame), {why}"
    )
