"""Arms that tests share: a pinhole that needs no simulator, and a real arm with something in its way."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.motion.arm import EyeInHandArm, Motion, Outcome
from gvp_lib.motion.primitives import turn

CAMERA = CameraIntrinsics(640, 480, 530.0, 530.0, 319.5, 239.5)
REACHED = Motion(True, Outcome.REACHED)
_BITS = 8  # of a pixel's fraction, for OpenCV


def white(rgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """The segmenter for what a `PinholeArm` draws."""
    return rgb[..., 0] > 127


@dataclass(frozen=True)
class Ball:
    """A small ball, drawn as a disc about the image of its center: all but a point."""

    center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radius: float = 0.005  # m

    def draw(self, image: NDArray[np.uint8], camera: CameraIntrinsics, camera_from_base: RigidTransform) -> None:
        x = camera_from_base.apply(self.center)
        if x[2] > 0.01:
            middle = np.rint(camera.project(x) * 2**_BITS).astype(int)
            size = round(float(camera.fx * self.radius / x[2] * 2**_BITS))
            cv2.circle(image, middle.tolist(), size, (255, 255, 255), cv2.FILLED, cv2.LINE_8, _BITS)


@dataclass(frozen=True)
class Plate:
    """A level rectangle without thickness."""

    center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sides: tuple[float, float] = (0.064, 0.032)  # m, along its own x and y
    yaw: float = 0.0  # rad, about the base's z

    def draw(self, image: NDArray[np.uint8], camera: CameraIntrinsics, camera_from_base: RigidTransform) -> None:
        corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) * (*self.sides, 0) / 2
        x = camera_from_base.apply(Rotation.from_rotvec([0, 0, self.yaw]).apply(corners) + self.center)
        if (x[:, 2] > 0.01).all():
            pixels = np.rint(camera.project(x) * 2**_BITS).astype(np.int32)
            cv2.fillConvexPoly(image, pixels, (255, 255, 255), cv2.LINE_8, _BITS)


class PinholeArm:
    """The least that motion needs: a camera that is wherever it is told to be and draws a few shapes, white on black.

    Its six joints are its position (m) and its rotation vector (rad). It begins ``radius`` m from the origin and looks
    there.
    """

    def __init__(self, *shapes: Ball | Plate, radius: float = 0.25, tilt: float = 0.0, azimuth: float = 0.0) -> None:
        self.shapes, self.intrinsics = shapes or (Ball(),), CAMERA
        self.stand_at(VirtualSphere(np.zeros(3), radius).viewpoint(tilt, azimuth))

    def stand_at(self, base_from_camera: RigidTransform) -> None:
        self._base_from_camera = base_from_camera

    @property
    def joints(self) -> NDArray[np.float64]:
        return np.concatenate([self._base_from_camera.translation, self._base_from_camera.rotation.as_rotvec()])

    def capture(self) -> NDArray[np.uint8]:
        image = np.zeros((self.intrinsics.height, self.intrinsics.width, 3), np.uint8)
        for shape in self.shapes:
            shape.draw(image, self.intrinsics, self._base_from_camera.inv())
        return image

    def camera_pose(self) -> RigidTransform:
        return self._base_from_camera

    def move_camera(self, camera_from_target: RigidTransform) -> Motion:
        self.stand_at(self._base_from_camera * camera_from_target)
        return REACHED

    def move_joints(self, q: ArrayLike) -> Motion:
        x = np.array(q, float)
        self.stand_at(RigidTransform.from_components(x[:3], Rotation.from_rotvec(x[3:])))
        return REACHED

    def rotate_wrist(self, angle: float) -> Motion:
        return self.move_camera(turn([0.0, 0.0, angle]))


class Hindered:
    """An arm that is stopped half-way in some motions of its camera, and sees nothing at some times.

    ``stops`` says by the number of the camera's motion, from 0, why it ends half-way; ``blind`` whether the arm sees
    nothing now, and ``frozen`` whether ``move_joints`` is barred.
    """

    def __init__(
        self,
        arm: EyeInHandArm,
        *,
        stops: Mapping[int, Outcome] | None = None,
        blind: Callable[[Hindered], bool] = lambda arm: False,
        frozen: Callable[[Hindered], bool] = lambda arm: False,
    ) -> None:
        self.arm, self.stops, self.blind, self.frozen = arm, stops or {}, blind, frozen
        self.intrinsics, self.camera_pose, self.rotate_wrist = arm.intrinsics, arm.camera_pose, arm.rotate_wrist
        self.motions = self.frames = self.returns = 0

    @property
    def joints(self) -> NDArray[np.float64]:
        return self.arm.joints

    def capture(self) -> NDArray[np.uint8]:
        self.frames += 1
        blind = self.blind(self)
        image = self.arm.capture()
        return np.zeros_like(image) if blind else image

    def move_camera(self, camera_from_target: RigidTransform) -> Motion:
        reason = self.stops.get(self.motions)
        self.motions += 1
        if reason is None:
            return self.arm.move_camera(camera_from_target)
        turn = Rotation.from_rotvec(0.5 * camera_from_target.rotation.as_rotvec())
        self.arm.move_camera(RigidTransform.from_components(0.5 * camera_from_target.translation, turn))
        return Motion(False, reason)

    def move_joints(self, q: ArrayLike) -> Motion:
        self.returns += 1
        return Motion(False, Outcome.COLLISION) if self.frozen(self) else self.arm.move_joints(q)
