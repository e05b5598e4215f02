"""Inverse kinematics of the camera in an arm's hand, by mink, and a search for an arm's home configuration."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import mink
import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import checked, finite
from gvp_lib.errors import InvalidParameterError, UnreachableError
from gvp_lib.picture import count
from gvp_lib.simulation.arms import ArmSpec
from gvp_lib.simulation.base import BASE_JOINTS
from gvp_lib.simulation.camera import optical_pose
from gvp_lib.simulation.drives import KinematicDrive
from gvp_lib.simulation.scene import ARM_PREFIX, Stage, build_scene

__all__ = ["InverseKinematics", "looking_down"]

_POSITION_TOLERANCE = 1e-4  # m
_ANGLE_TOLERANCE = np.radians(0.05)  # rad
_EXACT = 1e-6  # m and rad together: nothing is gained beyond it
_DAMPING = 1e-3  # weight of a unit cost against the pose's: it decides between ways to reach a pose, and nothing else
_MAX_STEP = 0.6  # rad, of any joint in one iteration: beyond it the linearization is worth little
_SEEDS = 8  # searches, of which the best answer counts
_RESTARTS = 60
_WINDING = 0.03  # m of height that a radian of the most turned joint is worth


@checked
class InverseKinematics:
    """Forward and inverse kinematics of the camera in an arm's hand, within the joint limits.

    Collisions are not checked; pass ``accept`` to :meth:`solve_any` to reject solutions for any reason. Joints that the
    spec does not name keep the model's rest position. On a mobile base, whose moves cost more than the arm's, the arm
    moves as far as it can and the base makes up the rest.

    Parameters
    ----------
    arm
        Arm. All poses are in its base frame.

    Attributes
    ----------
    name
        Name of the arm.

    Examples
    --------
    >>> from gvp_lib import ARMS
    >>> kinematics = InverseKinematics(ARMS["ur5e"])
    >>> base_from_camera = kinematics.forward(ARMS["ur5e"].home)
    >>> lower = base_from_camera * RigidTransform.from_translation([0.0, 0.0, 0.05])
    >>> q = kinematics.solve(lower, ARMS["ur5e"].home)
    >>> np.allclose(kinematics.forward(q).translation, lower.translation, atol=1e-4)
    True
    """

    def __init__(self, arm: ArmSpec) -> None:
        self.name, spec = arm.name, arm.load()
        for equality in list(spec.equalities):  # constraints between joints are not for the solver
            spec.delete(equality)
        self._model = model = spec.compile()
        ids = np.array([model.joint(name).id for name in arm.joints])
        dofs = model.jnt_dofadr[ids]
        self._qpos = model.jnt_qposadr[ids]
        self._revolute = model.jnt_type[ids] == int(mujoco.mjtJoint.mjJNT_HINGE)
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
            damping[dofs] = _DAMPING
            damping[dofs[: len(BASE_JOINTS)]] *= arm.base.cost
            self._tasks.append(mink.DampingTask(model, damping))
        self._limits = [mink.ConfigurationLimit(model, gain=1.0)]
        self._configuration = mink.Configuration(model)
        # Cached: an arm at rest is asked for its pose again and again, and constructing a RigidTransform is slow.
        self._last_forward = np.full(len(ids), np.nan), RigidTransform.identity()
        moving = np.flatnonzero(self._configuration.get_frame_jacobian(self._body, "body").any(axis=0))
        stray = np.setdiff1d(moving, dofs).tolist()
        self._frozen = [mink.DofFreezingTask(model, stray)] if stray else None

    def __repr__(self) -> str:
        return f"InverseKinematics({self.name}, {count(len(self._low), 'joint')})"

    @property
    def limits(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper joint limits, each of shape (n,), rad; infinite where a joint has none."""
        return self._low.copy(), self._high.copy()

    def forward(self, q: ArrayLike) -> RigidTransform:
        """Pose of the camera's optical frame, ``base_from_camera``.

        Parameters
        ----------
        q
            Joint angles, shape (n,), rad.
        """
        q = self.checked(q)
        cached_q, cached = self._last_forward
        if not np.array_equal(q, cached_q):
            self._put(q)
            data = self._configuration.data
            base_from_body = np.eye(4)
            base_from_body[:3, :3], base_from_body[:3, 3] = data.xmat[self._body].reshape(3, 3), data.xpos[self._body]
            cached = RigidTransform.from_matrix(base_from_body @ self._body_from_camera)
            self._last_forward = q.copy(), cached
        return cached

    def solve(
        self, base_from_camera: RigidTransform, q0: ArrayLike, max_iterations: int = 30
    ) -> NDArray[np.float64] | None:
        """Solve for a camera pose by local descent from ``q0``.

        Parameters
        ----------
        base_from_camera
            Target pose of the camera's optical frame.
        q0
            Initial joint angles, shape (n,), rad; clipped to the limits.
        max_iterations
            Limit on iterations; a pose a few centimeters away takes three.

        Returns
        -------
        ndarray or None
            Joint angles, shape (n,), rad, within the limits, that put the camera within 0.1 mm and 0.05 deg of the
            pose; None where the descent does not get there.
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
        """Solve for a camera pose from ``q0``, then from random starts ever further from it.

        Parameters
        ----------
        base_from_camera, q0
            As in :meth:`solve`.
        rng
            Generator, or a seed: the same seed gives the same answer.
        restarts
            Number of random starts before giving up.
        accept
            Predicate on joint angles; the first solution that it accepts is returned. None accepts any.

        Returns
        -------
        ndarray or None
            As in :meth:`solve`. A joint that can make more than one revolution ends within half a revolution of ``q0``
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
            # The same pose without whole revolutions, as near q0 as the limits allow.
            unwound = q + np.where(self._revolute, 2 * np.pi * np.round((q0 - q) / (2 * np.pi)), 0.0)
            q = np.where((unwound >= self._low) & (unwound <= self._high), unwound, q)
            if accept is None or accept(q):
                return q
        return None

    def _put(self, q: NDArray[np.float64]) -> None:
        full = self._model.qpos0.copy()
        full[self._qpos] = q
        self._configuration.update(full)

    def checked(self, q: ArrayLike) -> NDArray[np.float64]:
        """Validate joint angles and return them as an array.

        Parameters
        ----------
        q
            Joint angles, shape (n,), rad.

        Raises
        ------
        InvalidParameterError
            ``q`` has another shape, or is not finite.
        """
        q, n = np.asarray(q, float), self._low.size
        if q.shape != (n,) or not np.isfinite(q).all():
            raise InvalidParameterError(f"this arm has {n} joints: q is {n} finite numbers, in rad; got {q!r}")
        return q


@checked
def looking_down(arm: ArmSpec, height: float = 0.35) -> ArmSpec:
    """Solve for a home configuration whose camera looks straight down on the middle of the workspace.

    Away from the base is up in the image. Of several solutions that touch neither the table nor the arm itself, the one
    chosen carries the links high (elbow up) and turns no joint far from where the search started.

    Parameters
    ----------
    arm
        Arm; the search starts at its present home, or where the joints' ranges come nearest to it: all zeros will do.
    height
        Height of the camera above the table, m.

    Returns
    -------
    ArmSpec
        The same arm with the new home.

    Raises
    ------
    UnreachableError
        No joint angles within the limits and free of collision were found.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from gvp_lib import ARMS
    >>> unknown = replace(ARMS["ur5e"], home=(0.0,) * 6)
    >>> InverseKinematics(unknown).forward(looking_down(unknown).home).translation.round(3).tolist()
    [0.5, 0.0, 0.35]
    """
    finite(height=height)
    arm = arm.clipped()
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
