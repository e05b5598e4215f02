"""Collect a set of labeled viewpoints: fast, resumable, the same whoever collects it. Thesis 2.4.2, 2.4.3, 3.2.

The set is cut into shards, each a job of its own that depends on the recipe alone. A shard that comes back is written
whole, then noted with its checksum and counts in a journal; so whatever ends a run costs at most the shards in the
making.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform
from tqdm import tqdm

import gvp_lib
from gvp_lib.errors import DatasetError, WorkerDiedError
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.jobs import Journal, finished_jobs, write_file
from gvp_lib.learning.labels import label_views
from gvp_lib.learning.recipe import CollectionRecipe, Painter, redrawn, resized, viewpoints
from gvp_lib.learning.shards import CARD, COLUMNS, damage, encoded, read_card, shard_bytes, shard_name
from gvp_lib.motion.arm import Motion, StopReason
from gvp_lib.motion.centering import center_on_object
from gvp_lib.motion.sighting import Eye, View
from gvp_lib.perception.images import cropped
from gvp_lib.planning.plan import Action
from gvp_lib.simulation.arms import arm_spec
from gvp_lib.simulation.kinematics import InverseKinematics
from gvp_lib.simulation.objects import object_spec
from gvp_lib.simulation.scene import FLOATING
from gvp_lib.simulation.workcell import CellCache as Kept
from gvp_lib.simulation.workcell import WorkCell

__all__ = ["Collection", "Collector", "Shard", "collect_dataset", "collect_shard"]

_JOURNAL = ".collection.journal"
_PACKAGES = ("numpy", "scipy", "mujoco", "mink", "opencv-python-headless", "pyarrow")
_LICENSE = "cc0-1.0"


@dataclass(frozen=True)
class Collection:
    """What :func:`collect_dataset` did.

    Attributes
    ----------
    folder
        The set's folder.
    card
        Contents of its ``card.json``.
    collected
        Samples collected in this run; the others were there already.
    damaged
        Names of shards that were there, but not as their checksums say, and were collected again.
    """

    folder: Path
    card: dict[str, Any]
    collected: int
    damaged: tuple[str, ...]


def collect_dataset(
    folder: Path | str,
    recipe: CollectionRecipe | None = None,
    *,
    workers: int = 1,
    executor: Executor | None = None,
    progress: bool = True,
) -> Collection:
    """Collect a set of viewpoints into a folder, or what of it is not there yet.

    The same recipe gives the same files, to the last byte, whatever the number of workers and however often it was
    interrupted, as long as the same versions collect it, and the same renderer draws: one graphics card's picture is
    not another's to the last bit.

    Parameters
    ----------
    folder
        Made if need be. A set that is finished is checked, and what is damaged is collected again.
    recipe
        What to collect; by default the thesis's "Uniform" set of 4096 (3.2).
    workers
        Processes on this machine; of no account with an executor.
    executor
        Where to run instead, as in :func:`gvp_lib.jobs.run_jobs`.
    progress
        Whether to show a bar, with pictures per second and the time that is left.

    Raises
    ------
    DatasetError
        The folder holds a set of another recipe or of other versions, or something else; it cannot be written; or the
        arm cannot take up enough viewpoints. Nothing that was collected is lost.
    JournalError
        Another run is collecting into it.

    Examples
    --------
    >>> import tempfile
    >>> recipe = CollectionRecipe(arm="floating", n=16, seed=1)
    >>> done = collect_dataset(tempfile.mkdtemp(), recipe, progress=False)
    >>> done.collected, len(done.card["shards"])
    (16, 1)
    """
    recipe = recipe or CollectionRecipe()
    folder = Path(folder)
    identity = {"recipe": recipe.to_dict(), "versions": _versions()}
    jobs = dict(_jobs(recipe))
    _claim(folder, identity)
    with ExitStack() as stack:
        with _writing(folder / _JOURNAL):
            journal = stack.enter_context(Journal(folder / _JOURNAL, identity))
        known = _noted_in_card(folder) | journal.finished
        damaged = damage(folder, {name: entry["sha256"] for name, entry in known.items()})
        finished = {name: entry for name, entry in known.items() if name not in damaged}
        todo = {name: job for name, job in jobs.items() if name not in finished}
        failures: dict[str, str] = {}
        bar = stack.enter_context(
            tqdm(total=recipe.n, initial=_samples(finished), desc=folder.name, unit="image", disable=not progress)
        )
        shards = stack.enter_context(closing(finished_jobs(collect_shard, todo, executor=executor, workers=workers)))
        try:
            for name, result in shards:
                if result.failed:
                    failures[name] = result.error
                    continue
                shard: Shard = result.value
                finished[name] = {"sha256": hashlib.sha256(shard.parquet).hexdigest(), "counts": shard.counts}
                with _writing(folder / name):
                    write_file(folder / name, shard.parquet)
                    journal.append(name, json.dumps(finished[name]))
                bar.update(shard.counts["samples"])
        except WorkerDiedError as death:
            raise WorkerDiedError(
                f"{death}. {_samples(finished)} of {recipe.n} samples are collected and kept in {folder}, and the same "
                "command goes on from there"
            ) from death
        if failures:
            name, error = next(iter(failures.items()))
            raise DatasetError(
                f"{len(failures)} shards could not be collected, the first of them {name}:\n"
                f"{error.strip().splitlines()[-1]}\nThe others are kept. In full:\n{error}"
            )
        card = {**_card(recipe, identity), **_summary({name: finished[name] for name in jobs})}
        with _writing(folder / CARD):
            write_file(folder / "README.md", _readme(card).encode())
            write_file(folder / CARD, (json.dumps(card, indent=1) + "\n").encode())
            (folder / _JOURNAL).unlink(missing_ok=True)
    return Collection(folder, card, sum(len(jobs[name]["viewpoints"]) for name in todo), tuple(damaged))


def _jobs(recipe: CollectionRecipe) -> Iterator[tuple[str, dict[str, Any]]]:
    """Each shard's file, and how it is made: no shard has samples of two scenes."""
    cuts = [range(0, n, recipe.shard) for n in recipe.per_scene]
    count, number, first = sum(map(len, cuts)), 0, 0
    for scene, starts in enumerate(cuts):
        asked = viewpoints(recipe, scene)
        for start in starts:
            part = asked[start : start + recipe.shard]
            yield shard_name(number, count), {"recipe": recipe, "scene": scene, "first": first, "viewpoints": part}
            number, first = number + 1, first + len(part)


def _claim(folder: Path, identity: Mapping[str, Any]) -> None:
    """Refuse a folder that holds something else."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        there = {path.name for path in folder.iterdir()}
    except OSError as error:
        raise DatasetError(f"cannot use {folder} as a folder: {error.strerror or error}; give another") from error
    if CARD in there:
        theirs, what = read_card(folder), "a set"
    elif _JOURNAL in there:
        theirs, what = {}, "an unfinished set"
        with suppress(OSError, ValueError, KeyError, TypeError):  # torn, or no journal: its own reader sees to that
            theirs = dict(json.loads((folder / _JOURNAL).read_bytes().partition(b"\n")[0])["recipe"])
    elif there:
        raise DatasetError(
            f"{folder} is no set of viewpoints, and not empty: it holds {', '.join(sorted(there)[:3])}. Give another "
            "folder"
        )
    else:
        return
    for part, kind, advice in (
        ("recipe", "of another recipe", "Give another folder"),
        ("versions", "collected by other versions", "Install those, or give another folder"),
    ):
        was, now = theirs.get(part, identity[part]), identity[part]
        if names := [name for name in {**was, **now} if was.get(name) != now.get(name)]:
            difference = "; ".join(f"{name} is {was.get(name)} there and {now.get(name)} here" for name in names)
            raise DatasetError(f"{folder} holds {what} {kind}: {difference}. {advice}, or delete this one")


def _noted_in_card(folder: Path) -> dict[str, Any]:
    """Checksums and counts of the shards of a finished set."""
    if not (folder / CARD).exists():
        return {}
    card = read_card(folder)
    shards = zip(card["shards"].items(), card["counts_of_shards"], strict=True)
    return {name: {"sha256": digest, "counts": counts} for (name, digest), counts in shards}


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Where a file is written: what the disk refuses is a :class:`DatasetError` that says how to go on."""
    try:
        yield
    except OSError as error:
        raise DatasetError(
            f"cannot write {path}: {error.strerror or error}. What was collected before is kept; make room there, or "
            "give a folder that may be written, and the same command goes on from where it was"
        ) from error


def _samples(finished: Mapping[str, Any]) -> int:
    return sum(entry["counts"]["samples"] for entry in finished.values())


# --- the card ---------------------------------------------------------------------------------------------------------


def _versions() -> dict[str, str]:
    return {"gvp_lib": gvp_lib.__version__} | {name: metadata.version(name) for name in _PACKAGES}


def _card(recipe: CollectionRecipe, identity: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "title": f"{recipe.n} labeled viewpoints of {identity['recipe']['target']} ({recipe.placement}), "
        f"{recipe.sampling}",
        "what": "Pictures from a camera in a simulated arm's hand on a virtual sphere about an object, each labeled "
        "with the step over the sphere that brings the camera nearest to the object's normal.",
        "source": "gvp_lib, after Smith, Grasp Viewpoint Planning Methods for Low-cost Robotic Manipulators (2020), "
        "2.4.2",
        "license": _LICENSE,
        **identity,
        "columns": dict(COLUMNS),
        "actions": [action.name for action in Action],
    }


def _summary(shards: Mapping[str, Any]) -> dict[str, Any]:
    counts = [entry["counts"] for entry in shards.values()]
    refused: Counter[str] = Counter()
    actions: Counter[str] = Counter()
    for entry in counts:
        refused.update(entry["refused"])
        actions.update({Action(int(name)).name: number for name, number in entry["actions"].items()})
    total = {name: sum(entry[name] for entry in counts) for name in ("samples", "frames", "overflow", "replaced")}
    return {
        "counts": {
            **total,
            "arm_seconds": float(np.round(sum(entry["arm_seconds"] for entry in counts), 3)),
            "refused": dict(sorted(refused.items())),
            "actions": {action.name: actions[action.name] for action in Action},
        },
        "shards": {name: entry["sha256"] for name, entry in shards.items()},
        "counts_of_shards": counts,
    }


def _readme(card: Mapping[str, Any]) -> str:
    """The front matter by which Hugging Face's `datasets` finds the shards, and a page for people."""
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
_FEW = 4  # iterations that solve a pose within reach: what needs more is nearly always out of it
_FAR = 2.5  # rad, from one viewpoint to the next: another branch of the solution is nearer from home


@dataclass(frozen=True)
class Shard:
    """One shard of a set, collected.

    Attributes
    ----------
    parquet
        Contents of its file.
    counts
        JSON data: ``samples``, ``frames``, ``arm_seconds``, ``overflow``, ``replaced``, and by kind ``refused`` and
        ``actions``.
    """

    parquet: bytes
    counts: dict[str, Any]


def collect_shard(job: Mapping[str, Any]) -> Shard:
    """Collect one shard, in whatever process.

    Parameters
    ----------
    job
        ``recipe``; ``scene``; ``first``, the number of its first sample; ``viewpoints``, tilt, azimuth and roll of
        each, rad.
    """
    recipe, scene = job["recipe"], job["scene"]
    # The last one is kept, since a worker's shards are mostly of one scene.
    key = json.dumps([recipe.to_dict(), scene], sort_keys=True)
    collector = _kept.get(key, lambda: Collector(recipe, scene))
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
    cell
        The work cell, for whoever watches.
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
        self._kinematics: InverseKinematics | None = None
        if recipe.arm != FLOATING:
            spec = arm_spec(recipe.arm)
            self._kinematics = InverseKinematics(spec.kinematic_model(), spec.camera, spec.joints, spec.joint_costs)
            self._home = np.array(spec.home, float)
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
        self.cell.reset(noise_seed=np.random.SeedSequence([self.recipe.seed, _NOISE, first]))
        self.refused.clear()
        # Nothing touches the object here, so that it stands where it stands.
        truth = self.cell.truth
        self._normal, self._object = truth.normal, _numbers(RigidTransform.concatenate([truth.world_from_object]))[0]
        sphere = VirtualSphere(truth.world_from_object.translation, self.recipe.radius, self._normal.direction)

        @cache
        def tried(attempt: int) -> tuple[NDArray[np.float64], RigidTransform]:
            """The viewpoints of an attempt and their poses, all at once: one by one they take ten times as long."""
            asked = redrawn(self.recipe, first, attempt, viewpoints) if attempt else viewpoints
            return asked, sphere.viewpoint(*asked.T)

        def of_sample(k: int) -> Iterator[tuple[NDArray[np.float64], RigidTransform]]:
            for asked, poses in map(tried, range(_ATTEMPTS)):
                yield asked[k], poses[k]

        return self._labeled([self._sample(first + k, of_sample(k)) for k in range(len(viewpoints))])

    def _sample(self, index: int, tries: Iterable[tuple[NDArray[np.float64], RigidTransform]]) -> dict[str, Any]:
        """Take up the first viewpoint that the arm can; a row of the set."""
        began, frames = self.cell.time, 0
        for attempt, (viewpoint, world_from_camera) in enumerate(tries, start=1):
            # A look of its own for each: in some, as on a table of the object's own hue, no viewpoint shows the object.
            self._painter.paint(np.random.default_rng([self.recipe.seed, _LOOK, index, attempt - 1]))
            eye = Eye(self.cell.arm, self.cell.segmenter, keep_images=True)
            found = self._take_up(world_from_camera, eye)
            frames += eye.looks
            if isinstance(found, View):
                return self._row(index, viewpoint, found) | {
                    "attempts": attempt,
                    "frames": frames,
                    "seconds": float(self.cell.time - began),
                }
            self.refused[found] += 1
        raise DatasetError(
            f"none of {_ATTEMPTS} viewpoints could be taken up for sample {index} ({dict(self.refused)}). Is the "
            "object within reach, and does the segmenter find it? A smaller radius or max_tilt may do, or another "
            "placement"
        )

    def _take_up(self, world_from_camera: RigidTransform, eye: Eye) -> View | str:
        """Move, and center (Algorithm 1): the last view, or what went wrong."""
        motion = self._move_to(world_from_camera)
        if not motion:
            return motion.reason.value
        centered = center_on_object(eye, threshold=self.recipe.threshold)
        return centered.view if centered and centered.view is not None else centered.trouble

    def _move_to(self, base_from_camera: RigidTransform) -> Motion:
        """Move the camera to a pose, straight in joint space.

        The pose is solved from where the joints are, since the next viewpoint is a near one. Going on like that winds
        up the wrist; where a limit ends it, or something is in the way, the pose is solved anew from home.
        """
        arm, kinematics = self.cell.arm, self._kinematics
        if kinematics is None:
            return arm.move_camera(arm.camera_pose().inv() * base_from_camera)
        here = arm.joints
        q = kinematics.solve(base_from_camera, here, max_iterations=_FEW)
        if q is not None and np.abs(q - here).max() < _FAR and (motion := arm.move_joints(q)):
            return motion
        q = kinematics.solve(base_from_camera, self._home, max_iterations=2 * _FEW)
        if q is None:
            return Motion(False, StopReason.UNREACHABLE)
        motion = arm.move_joints(q)
        if not motion and arm.move_joints(self._home):  # something was in the way
            motion = arm.move_joints(q)
        return motion

    def _row(self, index: int, viewpoint: NDArray[np.float64], view: View) -> dict[str, Any]:
        """All but the labels; poses as they come."""
        blob, side = view.blob, self.recipe.crop
        assert view.rgb is not None
        picture, (u, v) = cropped(view.rgb, side)
        u0, v0, u1, v1 = blob.bbox
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
        true, believed = (
            RigidTransform.concatenate([row[name] for row in rows])
            for name in ("world_from_camera", "base_from_camera")
        )
        labels = label_views(true, self._normal, self.recipe.step)
        columns: dict[str, Any] = {
            "action": labels.actions,
            "errors": labels.errors,
            "direction": labels.directions,
            "angle": labels.angles,
            "roll_error": [self._normal.roll_error(row["world_from_camera"]) for row in rows],
            "world_from_camera": _numbers(true),
            "base_from_camera": _numbers(believed),
        }
        return [row | {name: values[k] for name, values in columns.items()} for k, row in enumerate(rows)]


_kept: Kept[Collector] = Kept()


def _numbers(poses: RigidTransform) -> NDArray[np.float64]:
    """Positions and quaternions, shape (n, 7)."""
    return np.concatenate([poses.translation, poses.rotation.as_quat()], axis=1)
