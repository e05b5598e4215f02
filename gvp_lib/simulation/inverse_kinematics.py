"""Joint angles that put the camera in the hand where it is wanted, through mink."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mink
import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError, ModelError
from gvp_lib.simulation.frames import optical_pose

__all__ = ["InverseKinematics"]

Accept = Callable[[NDArray[np.float64]], bool]

POSITION_TOLERANCE = 1e-4  # m
ANGLE_TOLERANCE = np.radians(0.05)  # rad
_EXACT = 1e-6  # m and rad together: nothing is gained beyond it
_CHEAP = 1e-3  # of a unit cost against the pose's: it decides between ways to reach a pose, and nothing else
_MAX_STEP = 0.6  # rad, of any joint in one iteration: beyond it the linearization is worth little


class InverseKinematics:
    """Inverse and forward kinematics of a camera in a hand, within the joint limits.

    Nothing here knows about collisions; ``accept`` lets a caller refuse a solution for any reason.

    Parameters
    ----------
    model
        The compiled arm, best from :meth:`gvp_lib.simulation.arms.ArmSpec.kinematic_model`. Its world frame
        is the base frame of every pose here.
    camera
        The camera's name.
    joints
        Names of the joints that may move. All others stay as the model has them at rest.
    costs
        What it costs to move each of them by 1 rad or 1 m; squares add up. None where all cost the same, which matters
        only to an arm with more joints than it needs.
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
            base_from_body = _matrix(data.xmat[self._body].reshape(3, 3), data.xpos[self._body])
            known = RigidTransform.from_matrix(base_from_body @ self._body_from_camera)
            self._last_forward = q.copy(), known
        return known

    def solve(
        self, base_from_camera: RigidTransform, q0: ArrayLike, max_iterations: int = 30
    ) -> NDArray[np.float64] | None:
        """The joint angles nearest ``q0`` downhill, or None where the descent does not reach the pose.

        Parameters
        ----------
        base_from_camera
            The pose of the camera's optical frame that is wanted.
        q0
            Joint angles to start from, shape (n,), rad; brought within the limits where they are outside.
        max_iterations
            A pose a few centimeters away takes three.

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
            A generator, or a seed: the same seed gives the same answer.
        restarts
            Random starts before the pose is given up.
        accept
            Called with each solution; the first for which it returns true is the answer. None takes any.

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
        """The same pose with whole turns taken off, as near ``q0`` as the limits allow."""
        turns = np.where(self._turns, 2 * np.pi * np.round((q0 - q) / (2 * np.pi)), 0.0)
        inside = (q + turns >= self._low) & (q + turns <= self._high)
        return np.where(inside, q + turns, q)

    def _close(self, error: NDArray[np.float64]) -> bool:
        # The body's error, seen at the camera, which stands off the body's origin.
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


def _id(model: mujoco.MjModel, kind: mujoco.mjtObj, word: str, name: str) -> int:
    found = mujoco.mj_name2id(model, kind, name)
    if found < 0:
        count = {"camera": model.ncam, "joint": model.njnt}[word]
        known = ", ".join(mujoco.mj_id2name(model, kind, i) or "" for i in range(count)) or "none"
        raise ModelError(f"the model has no {word} {name!r}. It has: {known}")
    return int(found)


def _matrix(rotation: NDArray[np.float64], translation: NDArray[np.float64]) -> NDArray[np.float64]:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, translation
    return matrix


def _dofs_of_chain(model: mujoco.MjModel, body: int) -> set[int]:
    """Degrees of freedom that move a body."""
    dofs: set[int] = set()
    while body:
        first, count = model.body_dofadr[body], model.body_dofnum[body]
        dofs.update(range(first, first + count))
        body = int(model.body_parentid[body])
    return dofs
