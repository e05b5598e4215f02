"""One worker's part of a set: from viewpoint to viewpoint, center, capture, label. Thesis 2.4.2, 2.4.3."""

from __future__ import annotations

import base64
import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import DatasetError
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.learning.labels import label_views
from gvp_lib.learning.pictures import cropped
from gvp_lib.learning.recipe import CollectionRecipe
from gvp_lib.learning.sampling import redrawn
from gvp_lib.learning.shards import encoded, shard_bytes
from gvp_lib.learning.variation import Painter, resized
from gvp_lib.motion.arm import StopReason
from gvp_lib.motion.centering import center_on_object
from gvp_lib.motion.sighting import Eye, View
from gvp_lib.simulation.arms import ArmSpec, arm_spec
from gvp_lib.simulation.kinematics import InverseKinematics
from gvp_lib.simulation.objects import object_spec
from gvp_lib.simulation.scene import FLOATING
from gvp_lib.simulation.sensors import EpisodeNoise
from gvp_lib.simulation.workcell import CellCache, WorkCell

__all__ = ["Collector", "collect_shard"]

_SIZE, _NOISE, _LOOK = 3, 4, 5  # streams of random numbers; `sampling` has the others
_ATTEMPTS = 60
_FEW = 4  # iterations that solve a pose within reach: what needs more is nearly always out of it
_FAR = 2.5  # rad, from one viewpoint to the next: another branch of the solution is nearer from home
LOST, OFF_CENTER = "target lost", "not centered"


def collect_shard(job: Mapping[str, Any]) -> dict[str, Any]:
    """Collect one shard; for :func:`gvp_lib.jobs.run_jobs`.

    Parameters
    ----------
    job
        ``recipe``; ``scene``; ``first``, the number of its first sample; ``viewpoints``, tilt, azimuth and roll of
        each, rad.

    Returns
    -------
    dict
        JSON data: ``parquet``, the file in base 64; ``sha256`` of it; ``counts``.
    """
    collector = _collector(job["recipe"], job["scene"])
    rows = collector.collect(job["first"], np.array(job["viewpoints"], float))
    data = shard_bytes(rows)
    return {
        "parquet": base64.b64encode(data).decode(),
        "sha256": hashlib.sha256(data).hexdigest(),
        "counts": {
            "samples": len(rows),
            "frames": sum(row["frames"] for row in rows),
            "arm_seconds": float(sum(row["seconds"] for row in rows)),
            "overflow": sum(row["overflow"] for row in rows),
            "replaced": sum(row["attempts"] > 1 for row in rows),
            "refused": dict(collector.refused),
            "actions": dict(Counter(str(int(row["action"])) for row in rows)),
        },
    }


def _collector(recipe: CollectionRecipe, scene: int) -> Collector:
    """The last one is kept, since a worker's shards are mostly of one scene."""
    return _kept.get(json.dumps([recipe.to_dict(), scene], sort_keys=True), lambda: Collector(recipe, scene))


class _Hand:
    """Moves an arm's camera to poses in the base frame, straight in joint space.

    A pose is solved from where the joints are, since the next viewpoint is a near one. Going on like that winds up the
    wrist; where a limit ends it, or something is in the way, the pose is solved anew from home.
    """

    def __init__(self, cell: WorkCell, arm: str | ArmSpec) -> None:
        self.arm = cell.arm
        self.kinematics: InverseKinematics | None = None
        if arm != FLOATING:
            spec = arm_spec(arm)
            self.kinematics = InverseKinematics(spec.kinematic_model(), spec.camera, spec.joints)
            self.home = np.array(spec.home, float)

    def move_to(self, base_from_camera: RigidTransform) -> StopReason:
        """REACHED, or why the camera is not there."""
        arm, kinematics = self.arm, self.kinematics
        if kinematics is None:
            return arm.move_camera(arm.camera_pose().inv() * base_from_camera).reason
        here = arm.joints
        q = kinematics.solve(base_from_camera, here, max_iterations=_FEW)
        if q is not None and np.abs(q - here).max() < _FAR and arm.move_joints(q):
            return StopReason.REACHED
        q = kinematics.solve(base_from_camera, self.home, max_iterations=2 * _FEW)
        if q is None:
            return StopReason.UNREACHABLE
        motion = arm.move_joints(q)
        if not motion and arm.move_joints(self.home):  # something was in the way
            motion = arm.move_joints(q)
        return motion.reason


@dataclass(frozen=True, eq=False)
class _Sight:
    """A viewpoint that was taken up: the last look, and how many there were."""

    view: View
    frames: int


class Collector:
    """The cell of one scene of a recipe, and the arm that goes from viewpoint to viewpoint in it.

    Parameters
    ----------
    recipe
        What is collected.
    scene
        Number of the placing of the object.

    Attributes
    ----------
    refused
        Why viewpoints of the present shard were not taken up, counted.
    """

    def __init__(self, recipe: CollectionRecipe, scene: int = 0) -> None:
        self.recipe, self.scene = recipe, scene
        factor = 1 + recipe.variation.size * np.random.default_rng([recipe.seed, _SIZE, scene]).uniform(-1, 1)
        self.cell = WorkCell(
            recipe.arm,
            resized(object_spec(recipe.target).centered(), float(factor)),
            recipe.placement,
            seed=np.random.SeedSequence([recipe.seed, scene]),
            noise=recipe.noise,
        )
        self._painter = Painter(self.cell, recipe.variation)
        self._hand = _Hand(self.cell, recipe.arm)
        self.refused: Counter[str] = Counter()

    def close(self) -> None:
        """Free the cell's graphics contexts."""
        self.cell.close()

    def collect(self, first: int, viewpoints: NDArray[np.float64]) -> list[dict[str, Any]]:
        """Rows of successive samples. The arm begins at home, with errors drawn anew.

        Parameters
        ----------
        first
            Number of the first sample, by which everything random is drawn.
        viewpoints
            Tilt, azimuth and roll of each, shape (n, 3), rad.

        Raises
        ------
        DatasetError
            For one of them, neither it nor any of what might replace it can be taken up.
        """
        self._begin(first)

        @cache
        def tried(attempt: int) -> tuple[NDArray[np.float64], RigidTransform]:
            """The viewpoints of an attempt and their poses, all at once: one by one they take ten times as long."""
            asked = redrawn(self.recipe, first, attempt, viewpoints) if attempt else viewpoints
            return asked, self._sphere.viewpoint(*asked.T)

        def of_sample(k: int) -> Iterator[tuple[NDArray[np.float64], RigidTransform]]:
            for asked, poses in map(tried, range(_ATTEMPTS)):
                yield asked[k], poses[k]

        return self._labeled([self._sample(first + k, of_sample(k)) for k in range(len(viewpoints))])

    def _begin(self, first: int) -> None:
        cell, recipe, truth = self.cell, self.recipe, self.cell.truth
        cell.reset()
        joints = 0 if self._hand.kinematics is None else len(self._hand.home)
        noise = EpisodeNoise(recipe.noise, joints, np.random.SeedSequence([recipe.seed, _NOISE, first]))
        cell.arm.begin_episode(noise)  # type: ignore[attr-defined]
        if joints:
            cell.arm.stand_at(self._hand.home + noise.joint_offset)  # type: ignore[attr-defined]
        self.refused.clear()
        # Nothing touches the object here, so that it stands where it stands.
        self._normal, self._object = truth.normal, _poses(RigidTransform.concatenate([truth.world_from_object]))[0]
        self._sphere = VirtualSphere(truth.world_from_object.translation, recipe.radius, self._normal.direction)

    def _sample(self, index: int, tries: Iterable[tuple[NDArray[np.float64], RigidTransform]]) -> dict[str, Any]:
        """Take up the first viewpoint that the arm can; a row of the set."""
        began, frames = self.cell.time, 0
        for attempt, (viewpoint, world_from_camera) in enumerate(tries, start=1):
            # A look of its own for each: in some, as on a table of the object's own hue, no viewpoint shows the object.
            self._painter.paint(np.random.default_rng([self.recipe.seed, _LOOK, index, attempt - 1]))
            seen = self._take_up(world_from_camera)
            if isinstance(seen, _Sight):
                return self._row(index, viewpoint, seen.view) | {
                    "attempts": attempt,
                    "frames": frames + seen.frames,
                    "seconds": float(self.cell.time - began),
                }
            reason, looks = seen
            self.refused[reason] += 1
            frames += looks
        raise DatasetError(
            f"none of {_ATTEMPTS} viewpoints could be taken up for sample {index} ({dict(self.refused)}). Is the "
            "object within reach, and does the segmenter find it? A smaller radius or max_tilt may do, or another "
            "placement"
        )

    def _take_up(self, world_from_camera: RigidTransform) -> _Sight | tuple[str, int]:
        """Move, and center (Algorithm 1); or why that failed, and how many pictures it took."""
        reason = self._hand.move_to(world_from_camera)
        if reason is not StopReason.REACHED:
            return reason.value, 0
        eye = Eye(self.cell.arm, self.cell.segmenter, keep_images=True)
        centered = center_on_object(eye, threshold=self.recipe.threshold)
        if centered and centered.view is not None:
            return _Sight(centered.view, eye.looks)
        if not centered.motion:
            return centered.motion.reason.value, eye.looks
        return (LOST if centered.view is None else OFF_CENTER), eye.looks

    def _row(self, index: int, viewpoint: NDArray[np.float64], view: View) -> dict[str, Any]:
        """All but the labels; poses as they come."""
        blob = view.blob
        assert view.rgb is not None
        picture, (u, v) = cropped(view.rgb, self.recipe.crop)
        u0, v0, u1, v1 = blob.bbox
        side = self.recipe.crop
        return {
            "image": {"bytes": encoded(picture), "path": None},
            "tilt": viewpoint[0],
            "azimuth": viewpoint[1],
            "roll": viewpoint[2],
            "world_from_camera": self.cell.truth.world_from_camera,
            "base_from_camera": view.base_from_camera,
            "world_from_object": self._object,
            "blob_area": blob.area,
            "blob_centroid": blob.centroid,
            "blob_orientation": blob.orientation,
            "blob_axes": [blob.axis_major_length, blob.axis_minor_length],
            "overflow": bool(u0 < u or v0 < v or u1 > u + side or v1 > v + side),
            "index": index,
            "scene": self.scene,
        }

    def _labeled(self, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """The same rows with their labels, and with poses as numbers: all at once, since one by one takes longer."""
        cameras = [row["world_from_camera"] for row in rows]
        true = RigidTransform.concatenate(cameras)
        believed = RigidTransform.concatenate([row["base_from_camera"] for row in rows])
        labels = label_views(true, self._normal, self.recipe.step)
        columns: dict[str, Any] = {
            "action": labels.actions,
            "errors": labels.errors,
            "direction": labels.directions,
            "angle": labels.angles,
            "roll_error": [self._normal.roll_error(camera) for camera in cameras],
            "world_from_camera": _poses(true),
            "base_from_camera": _poses(believed),
        }
        return [row | {name: values[k] for name, values in columns.items()} for k, row in enumerate(rows)]


_kept: CellCache[Collector] = CellCache()


def _poses(poses: RigidTransform) -> NDArray[np.float64]:
    """Positions and quaternions, shape (n, 7)."""
    return np.concatenate([poses.translation, poses.rotation.as_quat()], axis=1)
