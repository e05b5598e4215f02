"""What of a work cell is observed, pictures and poses, and how an episode stands. Thesis 2.4, State Space; 2.4.3."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from enum import StrEnum
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError, UnknownNameError
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.perception.images import shrunk
from gvp_lib.simulation.workcell import WorkCell

__all__ = ["PARTS", "Outcome", "State"]

PARTS = ("image", "believed_pose", "true_pose", "object_pose")
"""What a state may hold; :class:`gvp_lib.learning.environment.ViewpointEnv` says what each is."""

_FAR = 10.0  # m: no arm and no object stands so far from the base
_POSE_LIMIT = np.array([_FAR] * 3 + [1.0] * 6)


class Outcome(StrEnum):
    """How an episode stands, or why it ended."""

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


class State:
    """The parts of a state that are observed, and the memory for the last pictures.

    Parameters
    ----------
    observe
        Parts, of :data:`PARTS`, each once.
    frames
        How many pictures ``"image"`` holds.
    crop, size
        As for :func:`gvp_lib.perception.images.shrunk`.
    """

    def __init__(self, observe: str | Sequence[str], frames: int, crop: int | None, size: int | None) -> None:
        self.parts = _checked(observe)
        for name, value, least in (("frames", frames, 1), ("size", 8 if size is None else size, 8)):
            if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
                raise InvalidParameterError(f"{name} is a whole number, {least} or more; got {value!r}")
        self.frames, self.crop, self.size = int(frames), crop, size
        self._pictures: deque[NDArray[np.uint8]] = deque(maxlen=self.frames)

    def space(self, lens: CameraIntrinsics) -> spaces.Space[Any]:
        """Of the observations that a camera with this lens gives: a Box, or a Dict of several."""
        shape = shrunk(np.zeros((lens.height, lens.width, 3), np.uint8), self.crop, self.size).shape
        shape = shape if self.frames == 1 else (self.frames, *shape)
        high = _POSE_LIMIT.astype(np.float32)
        boxes: dict[str, spaces.Space[Any]] = {
            part: spaces.Box(0, 255, shape, np.uint8) if part == "image" else spaces.Box(-high, high, dtype=np.float32)
            for part in self.parts
        }
        return boxes[self.parts[0]] if len(boxes) == 1 else spaces.Dict(boxes)

    def begin(self, rgb: NDArray[np.uint8]) -> None:
        """Forget the pictures of the last episode; the first of this one stands for those before it."""
        self._pictures.extend([shrunk(rgb, self.crop, self.size)] * self.frames)

    def add(self, rgb: NDArray[np.uint8]) -> None:
        """One more picture, in full; the oldest is forgotten."""
        self._pictures.append(shrunk(rgb, self.crop, self.size))

    def observation(self, cell: WorkCell) -> Any:
        """The parts, in arrays that nobody else holds: the only one, or a dictionary of several."""
        parts = {part: self._part(part, cell) for part in self.parts}
        return parts[self.parts[0]] if len(parts) == 1 else parts

    def _part(self, part: str, cell: WorkCell) -> NDArray[Any]:
        if part == "image":
            return np.array(self._pictures if self.frames > 1 else self._pictures[-1])
        if part == "believed_pose":
            return _numbers(cell.arm.camera_pose())
        return _numbers(cell.truth.world_from_camera if part == "true_pose" else cell.truth.world_from_object)


def _numbers(pose: RigidTransform) -> NDArray[np.float32]:
    """Position and the frame's x and y axes, shape (9,)."""
    axes = pose.rotation.as_matrix()[:, :2].T.ravel()
    return np.concatenate([pose.translation, axes]).clip(-_POSE_LIMIT, _POSE_LIMIT).astype(np.float32)


def _checked(observe: str | Sequence[str]) -> tuple[str, ...]:
    parts = (observe,) if isinstance(observe, str) else tuple(observe)
    for part in parts:
        if part not in PARTS:
            raise UnknownNameError("part of an observation", part, PARTS)
    if not parts or len(set(parts)) < len(parts):
        raise InvalidParameterError(
            f"an observation is of one or more different parts, of {', '.join(PARTS)}; got {list(parts)}"
        )
    return parts
