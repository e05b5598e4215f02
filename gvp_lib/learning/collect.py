"""Collect a data set of labeled viewpoints: fast, resumable and reproducible. Thesis 2.4.2, 2.4.3, 3.2.

The data set is cut into shards, each a job that depends on the recipe alone. A finished shard is written whole, then
entered in the card with its checksum and counts, so whatever ends a run costs at most the shards in progress.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform
from tqdm import tqdm

import gvp_lib
from gvp_lib.checks import checked
from gvp_lib.errors import DatasetError, InvalidParameterError, WorkerDiedError
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.jobs import disk_errors, finished_jobs, open_locked, write_file
from gvp_lib.learning.labels import label_views
from gvp_lib.learning.recipe import CollectionRecipe, Painter, check_scene, redrawn, scaled_object, viewpoints
from gvp_lib.learning.shards import CARD, COLUMNS, as_path, damage, encoded, read_card, shard_bytes, shard_name
from gvp_lib.motion.arm import Motion, Outcome
from gvp_lib.motion.sighting import Eye, View, center_on_object
from gvp_lib.perception.images import center_crop
from gvp_lib.picture import count
from gvp_lib.planning.plan import Action
from gvp_lib.simulation.arms import arm_spec
from gvp_lib.simulation.kinematics import InverseKinematics
from gvp_lib.simulation.objects import object_spec
from gvp_lib.simulation.scene import FLOATING
from gvp_lib.simulation.workcell import CellCache, WorkCell

__all__ = ["Collection", "Collector", "Shard", "collect_dataset", "collect_shard"]

_LOCK = ".collecting"
_PACKAGES = ("numpy", "scipy", "mujoco", "mink", "opencv-python-headless", "pyarrow")


@dataclass(frozen=True)
class Collection:
    """Result of :func:`collect_dataset`.

    Attributes
    ----------
    folder
        Folder of the data set.
    card
        Contents of its ``card.json``.
    collected
        Number of samples collected in this run; the others were there before.
    damaged
        Names of shards that did not match their checksums and were collected again.
    """

    folder: Path
    card: dict[str, Any]
    collected: int
    damaged: tuple[str, ...]

    def __repr__(self) -> str:
        name, samples, damaged = self.folder.resolve().name, self.card["counts"]["samples"], len(self.damaged)
        return f"Collection({name}: {count(samples, 'sample')}, {self.collected} new, damaged shards: {damaged})"


@checked(own=("folder",))
def collect_dataset(
    folder: Path | str,
    recipe: CollectionRecipe | None = None,
    *,
    workers: int = 1,
    executor: Executor | None = None,
    progress: bool = True,
) -> Collection:
    """Collect a data set of labeled viewpoints into a folder, or what is missing from it.

    The same recipe gives the same files, to the last byte, whatever the number of workers and interruptions, as long as
    versions and renderer are the same: pictures from different graphics cards differ in the last bits.

    Parameters
    ----------
    folder
        Folder of the data set, created if missing. What it holds of the data set is verified, and damaged shards are
        collected again.
    recipe
        Settings of the data set; by default the thesis's "Uniform" one of 4096 samples (3.2).
    workers, executor
        Number of processes, and pool or cluster to run on, as in :func:`gvp_lib.jobs.run_jobs`.
    progress
        Whether to show a bar with pictures per second and the time left.

    Raises
    ------
    DatasetError
        The folder holds a data set of another recipe or other versions, or something else; another run collects into
        it; it cannot be written; or the arm cannot reach enough viewpoints. Nothing that was collected is lost.
    WorkerDiedError
        A worker process died. Nothing that was collected is lost.

    Examples
    --------
    >>> import tempfile
    >>> recipe = CollectionRecipe(arm="floating", n=16, seed=1)
    >>> collect_dataset(Path(tempfile.mkdtemp()) / "bricks", recipe, progress=False)
    Collection(bricks: 16 samples, 16 new, damaged shards: 0)
    """
    recipe = recipe or CollectionRecipe()
    folder = as_path(folder, "a set of viewpoints is", "a folder, given by its path")
    with ExitStack() as held:
        with disk_errors(folder, DatasetError):
            held.enter_context(open_locked(folder / _LOCK))
        held.callback((folder / _LOCK).unlink, missing_ok=True)
        known = _present_shards(folder, recipe)
        damaged = damage(folder, {name: digest for name, (digest, _) in known.items()})
        finished = {name: entry for name, entry in known.items() if name not in damaged}
        jobs = dict(_jobs(recipe))
        todo = {name: job for name, job in jobs.items() if name not in finished}
        left, failures = sum(len(job["viewpoints"]) for job in todo.values()), {}

        def write(name: str, data: bytes) -> None:
            with disk_errors(folder / name, DatasetError):
                write_file(folder / name, data)

        def write_card() -> dict[str, Any]:
            card = _card(recipe, {name: finished[name] for name in jobs if name in finished})
            write(CARD, (json.dumps(card, indent=1) + "\n").encode())
            return card

        card = write_card()
        write("README.md", _readme(card).encode())
        with (
            tqdm(total=recipe.n, initial=recipe.n - left, desc=folder.name, unit="image", disable=not progress) as bar,
            closing(finished_jobs(collect_shard, todo, executor=executor, workers=workers)) as shards,
        ):
            try:
                for name, result in shards:
                    if result.failed:
                        failures[name] = result.error
                        continue
                    shard: Shard = result.value
                    write(name, shard.parquet)
                    finished[name] = hashlib.sha256(shard.parquet).hexdigest(), shard.counts
                    card = write_card()
                    bar.update(shard.counts["samples"])
            except WorkerDiedError as death:
                raise WorkerDiedError(
                    f"{death}. {card['counts']['samples']} of {recipe.n} samples are collected and kept in {folder}, "
                    "and the same command goes on from there"
                ) from death
    if failures:
        name, error = next(iter(failures.items()))
        raise DatasetError(
            f"{len(failures)} shards could not be collected, the first of them {name}:\n"
            f"{error.strip().splitlines()[-1]}\nThe others are kept. In full:\n{error}"
        )
    return Collection(folder, card, left, tuple(damaged))


def _jobs(recipe: CollectionRecipe) -> Iterator[tuple[str, dict[str, Any]]]:
    """File name and argument of each shard's job: no shard has samples of two scenes."""
    cuts = [range(0, n, recipe.shard) for n in recipe.per_scene]
    count, number, first = sum(map(len, cuts)), 0, 0
    for scene, starts in enumerate(cuts):
        planned = viewpoints(recipe, scene)
        for start in starts:
            part = planned[start : start + recipe.shard]
            yield shard_name(number, count), {"recipe": recipe, "scene": scene, "first": first, "viewpoints": part}
            number, first = number + 1, first + len(part)


def _present_shards(folder: Path, recipe: CollectionRecipe) -> dict[str, tuple[str, dict[str, Any]]]:
    """Checksum and counts of each shard in a folder's card; refuse a folder that holds something else."""
    present = sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))
    if CARD not in present:
        if present:
            raise DatasetError(
                f"{folder} is no set of viewpoints, or one that an earlier version left unfinished: it holds "
                f"{', '.join(present[:3])} and no {CARD}. Give another folder"
            )
        return {}
    card = read_card(folder, unfinished=True)
    for part, ours, kind, advice in (
        ("recipe", recipe.to_dict(), "of another recipe", "Give another folder"),
        ("versions", _versions(), "collected by other versions", "Install those, or give another folder"),
    ):
        theirs = card[part]
        if names := [name for name in {**theirs, **ours} if theirs.get(name) != ours.get(name)]:
            difference = "; ".join(f"{name} is {theirs.get(name)} there and {ours.get(name)} here" for name in names)
            raise DatasetError(f"{folder} holds a set {kind}: {difference}. {advice}, or delete this one")
    shards = card["shards"]
    return dict(zip(shards, zip(shards.values(), card["counts_of_shards"], strict=True), strict=True))


# --- the card ---------------------------------------------------------------------------------------------------------


def _versions() -> dict[str, str]:
    return {"gvp_lib": gvp_lib.__version__} | {name: metadata.version(name) for name in _PACKAGES}


def _card(recipe: CollectionRecipe, shards: Mapping[str, tuple[str, dict[str, Any]]]) -> dict[str, Any]:
    """Contents of the card, given the checksum and counts of each shard that is present."""
    about, counts = recipe.to_dict(), [counts for _, counts in shards.values()]
    total = {name: sum(each[name] for each in counts) for name in ("samples", "frames", "overflow", "replaced")}
    refused = sum((Counter(each["refused"]) for each in counts), Counter[str]())
    return {
        "title": f"{recipe.n} labeled viewpoints of {about['target']} ({recipe.placement}), {recipe.sampling}",
        "what": "Pictures from a camera in a simulated arm's hand on a virtual sphere about an object, each labeled "
        "with the step over the sphere that brings the camera nearest to the object's normal.",
        "source": "gvp_lib, after Smith, Grasp Viewpoint Planning Methods for Low-cost Robotic Manipulators (2020), "
        "2.4.2",
        "license": "cc0-1.0",
        "recipe": about,
        "versions": _versions(),
        "columns": dict(COLUMNS),
        "actions": [action.name for action in Action],
        "counts": {
            **total,
            "arm_seconds": float(np.round(sum(each["arm_seconds"] for each in counts), 3)),
            "refused": dict(sorted(refused.items())),
            "actions": {a.name: sum(each["actions"].get(str(int(a)), 0) for each in counts) for a in Action},
        },
        "shards": {name: digest for name, (digest, _) in shards.items()},
        "counts_of_shards": counts,
    }


def _readme(card: Mapping[str, Any]) -> str:
    """Front matter by which Hugging Face's `datasets` finds the shards, then a page for people."""
    columns = "\n".join(f"| `{name}` | {what} |" for name, what in card["columns"].items())
    return f"""---
license: {card["license"]}
configs:
- config_name: default
  data_files: data/*.parquet
---

# {card["title"]}

{card["what"]}

Source: {card["source"]}. The recipe, counts, versions and checksums are in `{CARD}`.

| column | what it is |
|---|---|
{columns}
"""


# --- one shard: from viewpoint to viewpoint, center, capture, label ---------------------------------------------------

_SIZE, _NOISE, _LOOK = 3, 4, 5  # streams of random numbers; `recipe` has the others
_ATTEMPTS = 60
_FEW = 4  # iterations in which a pose within reach is solved; one that needs more is nearly always out of reach
_FAR = 2.5  # rad, for any joint, from one viewpoint to the next: from home, another branch of the solution is nearer


class Shard(NamedTuple):
    """Contents of a collected shard's file, and JSON data that counts what is in it and what was refused."""

    parquet: bytes
    counts: dict[str, Any]

    def __repr__(self) -> str:
        return f"Shard({count(self.counts['samples'], 'sample')}, {len(self.parquet) / 1000:.0f} kB)"


def collect_shard(job: Mapping[str, Any]) -> Shard:
    """Collect one shard.

    Parameters
    ----------
    job
        ``recipe``; ``scene``, the number of the scene; ``first``, the number of the shard's first sample;
        ``viewpoints``, tilt, azimuth and roll of each sample, shape (n, 3), rad.
    """
    recipe, scene = job["recipe"], job["scene"]
    key = json.dumps([recipe.to_dict(), scene], sort_keys=True)
    collector = _collectors.get(key, lambda: Collector(recipe, scene))
    rows = collector.collect(job["first"], job["viewpoints"])
    counts = {
        "samples": len(rows),
        "frames": sum(row["frames"] for row in rows),
        "arm_seconds": float(sum(row["seconds"] for row in rows)),
        "overflow": sum(row["overflow"] for row in rows),
        "replaced": sum(row["attempts"] > 1 for row in rows),
        "refused": dict(collector.refused),
        "actions": dict(Counter(str(int(row["action"])) for row in rows)),
    }
    return Shard(shard_bytes(rows), counts)


@checked
class Collector:
    """Work cell for one scene of a recipe, whose arm moves from viewpoint to viewpoint.

    Parameters
    ----------
    recipe
        Settings of the data set.
    scene
        Number of the scene, from 0.

    Attributes
    ----------
    recipe, scene
        As given.
    cell
        Work cell, for watching the arm collect.
    refused
        Number of viewpoints refused since the last call of ``collect``, by reason.

    Examples
    --------
    >>> recipe = CollectionRecipe(arm="floating", sampling="random", n=2)
    >>> collector = Collector(recipe)
    >>> len(collector.collect(0, viewpoints(recipe)))
    2
    >>> collector
    Collector(cuboid_1x2 flat, scene 0 of 1, 0 viewpoints refused)
    >>> collector.close()
    """

    def __init__(self, recipe: CollectionRecipe, scene: int = 0) -> None:
        check_scene(recipe, scene)
        self.recipe, self.scene = recipe, scene
        factor = 1 + recipe.variation.size * np.random.default_rng([recipe.seed, _SIZE, scene]).uniform(-1, 1)
        self.cell = WorkCell(
            recipe.arm,
            scaled_object(object_spec(recipe.target).centered(), float(factor)),
            recipe.placement,
            seed=np.random.SeedSequence([recipe.seed, scene]),
            noise=recipe.noise,
        )
        self._painter = Painter(self.cell, recipe.variation)
        self._kinematics = None if recipe.arm == FLOATING else InverseKinematics(arm_spec(recipe.arm))
        self.refused: Counter[str] = Counter()

    def __repr__(self) -> str:
        target, scenes = self.cell.target_spec.name, self.recipe.scenes
        refused = f"{count(self.refused.total(), 'viewpoint')} refused"
        return f"Collector({target} {self.recipe.placement}, scene {self.scene} of {scenes}, {refused})"

    def close(self) -> None:
        """Free the graphics contexts of the cell."""
        self.cell.close()

    def collect(self, first: int, viewpoints: NDArray[np.float64]) -> list[dict[str, Any]]:
        """Collect successive samples and return their rows: values by column name.

        The arm starts at home, with newly drawn noise.

        Parameters
        ----------
        first
            Number of the first sample, on which everything random depends.
        viewpoints
            Tilt, azimuth and roll of each sample, shape (n, 3), rad.

        Raises
        ------
        DatasetError
            The arm can reach neither one of the viewpoints nor any of its replacements.
        """
        viewpoints = np.asarray(viewpoints, float)
        if viewpoints.ndim != 2 or viewpoints.shape[1:] != (3,) or not np.isfinite(viewpoints).all():
            raise InvalidParameterError(
                f"viewpoints are tilts, azimuths and rolls, finite, shape (n, 3), rad; got the shape {viewpoints.shape}"
            )
        self.cell.reset(noise_seed=np.random.SeedSequence([self.recipe.seed, _NOISE, first]))
        self.refused.clear()
        truth = self.cell.truth
        normal, world_from_object = truth.normal, truth.world_from_object  # nothing here touches the object
        sphere = VirtualSphere(world_from_object.translation, self.recipe.radius, normal.direction)

        @cache
        def candidates(attempt: int) -> tuple[NDArray[np.float64], RigidTransform]:
            """Viewpoints and poses of an attempt, all at once: one by one they take ten times as long."""
            drawn = redrawn(self.recipe, first, attempt, viewpoints) if attempt else viewpoints
            return drawn, sphere.viewpoint(*drawn.T)

        rows = []
        for k in range(len(viewpoints)):
            attempts = ((drawn[k], poses[k]) for drawn, poses in map(candidates, range(_ATTEMPTS)))
            rows.append(self._sample(first + k, attempts))
        # Labels, too, are much faster all at once.
        true, believed = (
            RigidTransform.concatenate([row[name] for row in rows])
            for name in ("world_from_camera", "base_from_camera")
        )
        labels = label_views(true, normal, self.recipe.step)
        columns: dict[str, Any] = {
            "action": labels.actions,
            "errors": labels.errors,
            "direction": labels.directions,
            "angle": labels.angles,
            "roll_error": [normal.roll_error(row["world_from_camera"]) for row in rows],
            "world_from_camera": _position_and_quaternion(true),
            "base_from_camera": _position_and_quaternion(believed),
            "world_from_object": [_position_and_quaternion(world_from_object)] * len(rows),
        }
        return [row | {name: values[k] for name, values in columns.items()} for k, row in enumerate(rows)]

    def _sample(self, index: int, attempts: Iterable[tuple[NDArray[np.float64], RigidTransform]]) -> dict[str, Any]:
        """Row without its labels, from the first viewpoint that the arm reaches and centers in (Algorithm 1)."""
        began, frames = self.cell.time, 0
        for attempt, (viewpoint, world_from_camera) in enumerate(attempts, start=1):
            # Each gets its own look: with some, such as a table of the object's hue, no viewpoint shows the object.
            self._painter.paint(np.random.default_rng([self.recipe.seed, _LOOK, index, attempt - 1]))
            motion = self._move_to(world_from_camera)
            if not motion:
                self.refused[motion.reason.value] += 1
                continue
            eye = Eye(self.cell.arm, self.cell.segmenter, keep_images=True)
            centered = center_on_object(eye, threshold=self.recipe.threshold)
            frames += eye.looks
            if not centered or centered.view is None:
                self.refused[centered.outcome.value] += 1
                continue
            return self._view_columns(centered.view) | {
                "tilt": viewpoint[0],
                "azimuth": viewpoint[1],
                "roll": viewpoint[2],
                "index": index,
                "scene": self.scene,
                "attempts": attempt,
                "frames": frames,
                "seconds": float(self.cell.time - began),
            }
        raise DatasetError(
            f"none of {_ATTEMPTS} viewpoints could be taken up for sample {index} ({dict(self.refused)}). Is the "
            "object within reach, and does the segmenter find it? A smaller radius or max_tilt may do, or another "
            "placement"
        )

    def _move_to(self, base_from_camera: RigidTransform) -> Motion:
        """Move the camera to a pose, straight in joint space.

        The pose is solved from the current joints, as the next viewpoint is near. That gradually winds up the wrist;
        at a limit, or where something is in the way, the pose is solved again from home.
        """
        arm, kinematics = self.cell.arm, self._kinematics
        if kinematics is None:
            return arm.move_camera(arm.camera_pose().inv() * base_from_camera)
        current, home = arm.joints, np.array(arm_spec(self.recipe.arm).home, float)
        q = kinematics.solve(base_from_camera, current, max_iterations=_FEW)
        if q is not None and np.abs(q - current).max() < _FAR and (motion := arm.move_joints(q)):
            return motion
        q = kinematics.solve(base_from_camera, home, max_iterations=2 * _FEW)
        if q is None:
            return Motion(False, Outcome.UNREACHABLE)
        motion = arm.move_joints(q)
        if not motion and arm.move_joints(home):  # something was in the way
            motion = arm.move_joints(q)
        return motion

    def _view_columns(self, view: View) -> dict[str, Any]:
        """Columns that describe a view; poses are still transforms."""
        blob, side = view.blob, self.recipe.crop
        assert view.rgb is not None
        picture, (u, v) = center_crop(view.rgb, side)
        u0, v0, u1, v1 = blob.bbox
        return {
            "image": {"bytes": encoded(picture), "path": None},
            "world_from_camera": self.cell.truth.world_from_camera,
            "base_from_camera": view.base_from_camera,
            "blob_area": blob.area,
            "blob_centroid": blob.centroid,
            "blob_orientation": blob.orientation,
            "blob_axes": [blob.axis_major_length, blob.axis_minor_length],
            "overflow": bool(u0 < u or v0 < v or u1 > u + side or v1 > v + side),
        }


_collectors: CellCache[Collector] = CellCache()  # a worker's shards are mostly of one scene


def _position_and_quaternion(poses: RigidTransform) -> NDArray[np.float64]:
    """Position and quaternion of each pose, shape (..., 7)."""
    return np.concatenate([poses.translation, poses.rotation.as_quat()], axis=-1)
