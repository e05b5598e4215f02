"""What must not change: three starts of every case of every stored result, in full precision, under ``tests/golden/``.

    python tests/golden.py check                        # run the first start of every third case again: `make full`
    python tests/golden.py check --starts 3 --every 1   # run all of them
    python tests/golden.py write [NAME ...]   # write them anew, where a change is meant

A stored result holds if its episodes, run again, are the same. On a platform with the fingerprint of the one that wrote
them (processor, renderer, the packages that compute) that means to the last bit; on another, where a renderer moves an
edge by a pixel, within tolerances, for episodes that are no leap away from another answer.

A network that does not come with the library cannot be run again. For what rests on one, the file ``networks`` has its
inputs (the first pictures of its set, with their labels) and one forward pass of it before any training; of an episode
of its own, the start and all methods that need no such network.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import platform
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache, reduce
from importlib import metadata
from operator import getitem
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gvp_book.experiments import learned
from gvp_book.experiments.networks import NETWORKS, SETS
from gvp_book.results import Experiment
from gvp_book.tables import SEEDS, TABLES
from gvp_lib.jobs import run_jobs

STARTS = 3
FOLDER = Path(__file__).parent / "golden"
SEED = 2020
SHIPPED = {"1x2-random-0": "actions-1x2", "tilt-1x2": "tilt-1x2", "tilt-all": "tilt-all"}
"""Networks of the experiments that come with the library, in 8 bits, and the names of their files."""

_COMPUTING = ("numpy", "scipy", "opencv-python-headless", "mujoco", "mink", "daqp", "torch")
_PICTURES = 4  # of each set, which the forward passes are of
_ENOUGH = 48  # starts, among whose jobs are three of every kind

Row = dict[str, Any]


class Replay(NamedTuple):
    """How the episodes of one stored result are run again: one episode, and all jobs, whose keys end in the start."""

    once: Callable[[Mapping[str, Any]], Row]
    jobs: Mapping[str, Row]

    def first(self, starts: int) -> dict[str, Row]:
        """The jobs of the first starts of each case."""
        return {key: job for key, job in self.jobs.items() if int(key.rpartition("/")[2]) < starts}


@cache
def replays(name: str) -> Replay:
    """What runs the episodes of a stored result again."""
    if name == "networks":
        return Replay(pass_once, {f"{network}/0": {"network": network} for network in one_of_each_kind()})
    experiment = TABLES[name]
    if isinstance(experiment, Experiment):
        jobs = experiment.jobs(SEEDS[name], _ENOUGH)
        return Replay(experiment.once, {key: job for key, job in jobs.items() if is_of_few(name, job)})
    if name == "moving-object":
        return Replay(learned.follow_once, learned.following_jobs(SEED, _ENOUGH))
    jobs = learned.learned_jobs(name, SEED, STARTS, large=name in learned.WITH_RESNET50)
    return Replay(learned.step_over_once, {key: with_shipped(job) for key, job in jobs.items()})


NAMES = ("table-3.1", "table-3.2", "table-3.3", "table-3.4", "direction-head", "augmentation", "moving-object", "reach",
         "outlines", "objects", "photographs", "networks")  # fmt: skip
"""The files of golden episodes. Figures 3.3 and 3.4 rest on networks alone, which the last has."""


def is_of_few(name: str, job: Row) -> bool:
    """Whether a job is run again: of two dozen things those about two, of half a dozen packages those about one."""
    few = {"objects": ("soap", "mug"), "photographs": ("tea",)}
    return name not in few or (job["target"] if "target" in job else job["package"]) in few[name]


def with_shipped(job: Row) -> Row:
    """A job with those of its methods that need no network, or one that comes with the library."""
    methods = {
        name: {**method, "weights": SHIPPED[method["network"]]} if "network" in method else method
        for name, method in job["methods"].items()
        if "network" not in method or str(method["network"]) in SHIPPED
    }
    return {**job, "methods": methods}


# --- networks that do not come with the library ---------------------------------------------------------------------


def one_of_each_kind() -> list[str]:
    """The first network of each set and kind that is not shipped: what its trainings with other seeds begin like."""
    kinds: dict[Any, str] = {}
    for name, recipe in NETWORKS.items():
        config = recipe.config
        kinds.setdefault((recipe.sets, config.network, config.size, config.target), name)
    return [name for name in kinds.values() if name not in SHIPPED]


def pass_once(job: Mapping[str, Any]) -> Row:
    """The first pictures of the first set of a network, with their labels, and what it says of them untrained."""
    import torch

    from gvp_lib.learning.config import OBJECTIVES
    from gvp_lib.learning.policy import on_threads
    from gvp_lib.learning.resnet import ResNet, scaled
    from gvp_lib.perception.images import crop_and_resize

    recipe = NETWORKS[job["network"]]
    config = recipe.config
    rows = first_samples(recipe.sets[0])
    pictures = np.stack(
        [crop_and_resize(row["picture"], config.crop or SETS[recipe.sets[0]].crop, config.size) for row in rows]
    )
    torch.manual_seed(config.seed)
    network = ResNet(config.network, OBJECTIVES[config.target].outputs).eval()
    with on_threads(1), torch.inference_mode():
        outputs = network(scaled(pictures))
    return {
        "set": recipe.sets[0],
        "pictures": [hashlib.sha256(row["picture"].tobytes()).hexdigest()[:16] for row in rows],
        "brightness": [float(row["picture"].mean()) for row in rows],
        "actions": [int(row["action"]) for row in rows],
        "angles": [float(row["angle"]) for row in rows],
        "outputs": [[float(value) for value in row] for row in outputs.numpy()],
    }


def first_samples(name: str) -> list[Row]:
    """The first samples of a set, each with its ``picture``, uint8 (H, W, 3)."""
    import cv2

    from gvp_lib.learning.collect import Collector
    from gvp_lib.learning.recipe import viewpoints

    collector = Collector(SETS[name])
    try:
        rows = collector.collect(0, viewpoints(SETS[name])[:_PICTURES])
    finally:
        collector.close()
    for row in rows:
        encoded = np.frombuffer(row["image"]["bytes"], np.uint8)
        row["picture"] = cv2.cvtColor(cv2.imdecode(encoded, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    return rows


# --- fingerprint ----------------------------------------------------------------------------------------------------


def fingerprint() -> Row:
    """What decides the bits of an episode: the processor, what draws, and the packages that compute."""
    import gvp_lib.simulation  # noqa: F401, I001 - before MuJoCo, which then chooses how it draws
    import mujoco
    from OpenGL import GL

    context = mujoco.GLContext(16, 16)
    context.make_current()
    drawn_by = [bytes(GL.glGetString(name)).decode() for name in (GL.GL_RENDERER, GL.GL_VERSION)]
    context.free()
    versions = {package: metadata.version(package).partition("+")[0] for package in _COMPUTING}
    versions = {"python": ".".join(platform.python_version_tuple()[:2]), **versions}  # a patch of it changes no bit
    return {"processor": processor(), "renderer": ", ".join(drawn_by), **versions}


def processor() -> str:
    """Its model, and the widest instructions that NumPy found in it."""
    widest = np.show_config(mode="dicts")["SIMD Extensions"]["found"][-1:]
    kernel = os.environ.get("OPENBLAS_CORETYPE", "")  # where it is set, BLAS computes as on that one
    try:
        first = Path("/proc/cpuinfo").read_text("utf-8").partition("\n\n")[0]
        found = dict(re.split(r"\s*:\s*", line, maxsplit=1) for line in first.splitlines() if ":" in line)
        model = " ".join(found[key] for key in ("vendor_id", "cpu family", "model", "model name") if key in found)
    except OSError:  # a Mac
        model = platform.processor()
    return " ".join(filter(None, [platform.machine(), model, *widest, kernel]))


# --- files ----------------------------------------------------------------------------------------------------------


def read(name: str) -> tuple[Row, dict[str, Row]]:
    """The fingerprint of what wrote a file, and its episodes."""
    stored = json.loads((FOLDER / f"{name}.json").read_text("utf-8"))
    return stored["fingerprint"], stored["episodes"]


def write(name: str, episodes: Mapping[str, Row]) -> None:
    """An episode a line, so that a diff shows which have moved."""
    lines = ",\n".join(f"{json.dumps(key)}: {json.dumps(row)}" for key, row in episodes.items())
    text = f'{{"fingerprint": {json.dumps(fingerprint(), indent=1)},\n"episodes": {{\n{lines}\n}}}}\n'
    (FOLDER / f"{name}.json").write_text(text, "utf-8")


def run(job: Mapping[str, Any]) -> Row:
    """One episode, of the file ``of``."""
    return replays(job["of"]).once(job["job"])


def run_all(
    names: Sequence[str], starts: int, every: int, workers: int, *, written: bool = False
) -> dict[str, dict[str, Row]]:
    """Rows by file and key, as JSON brings them back, of the first starts of each ``every``-th case; or of those among
    them that are ``written``."""
    jobs = {
        f"{name}:{key}": {"of": name, "job": job}
        for name in names
        for key, job in list(replays(name).first(starts).items())[::every]
        if not written or key in read(name)[1]
    }
    rows: dict[str, dict[str, Row]] = {name: {} for name in names}
    for job, result in run_jobs(run, jobs, workers=workers, title="golden episodes").items():
        if result.failed:
            raise SystemExit(f"{job} failed:\n{result.error}")
        name, _, key = job.partition(":")
        rows[name][key] = result.value
    return rows


def differing(golden: Any, found: Any, place: str = "") -> list[str]:
    """Where a row differs in any bit of what was written; a column that is new says nothing of what was."""
    if isinstance(golden, dict) and isinstance(found, dict):
        return [line for key in golden for line in differing(golden[key], found.get(key), f"{place}.{key}")]
    return [] if golden == found else [f"{place[1:]} was {golden!r} and is {found!r}"]


NEAR: Mapping[str, Mapping[str, Mapping[str, float]]] = {
    "table-3.1": {
        case: {
            "start.tilt": 0.01,
            "quartic.total": 3.0,
            "silhouette.total": 0.5,
            "ours.total": 0.5,
            "look_down.total": 0.5,
        }
        for case in ("thesis/cuboid_1x2/flat", "none/cuboid_1x4/tilted", "none/cylinder/side")
    },
    "table-3.2": {
        f"thesis/{case}": {
            "tilt": 0.1,
            "thesis.error": 3.0,
            "moments.error": fit,
            "thesis.success": 0,
            "moments.success": 0,
        }
        for case, fit in (("cuboid_1x2/raised", 0.5), ("cylinder/side", 0.5), ("alligator/flat", 3.0))
    },
    "table-3.3": {"clean/cuboid_1x2": {"start.tilt": 0.1, "random.total": 4.0, "oracle.total": 0.3}},
    "table-3.4": {"clean/cuboid_1x3 in blue": {"start.tilt": 0.1, "random.total": 4.0, "oracle.total": 0.3}},
    "direction-head": {case: {"start.tilt": 0.1, "all.total": 0.6} for case in ("clean/cuboid_1x2", "rough/alligator")},
    "augmentation": {"clean/cuboid_1x2": {"start.tilt": 0.1}},
    "moving-object": {"slides at 5 mm/s": {"tilt.error": 0.8}},
    "reach": {
        case: {"tilt": 0.1, "stands": 0, "comes": 0}
        for case in ("ur5e/fixed/0.3 m farther/60", "baxter/base/in the workspace/60")
    },
    "outlines": {case: {"total": 0.5} for case in ("walled/cuboid_1x4/walled", "holes/cylinder/flat")},
    "objects": {"alone/soap": {"tilt": 0.1, "look_down.success": 0}},
    "photographs": {"sheet/tea": {"error": 0.5}, "bare/tea": {"iou.learned": 0.03}},
    "networks": {"1x2-uniform-0": {"brightness": 1.0, "actions": 0, "angles": 1e-3}},
}
"""Cases that are compared on any platform: of each, places in its row and how far they may be off (deg)."""


def far_off(name: str, key: str, golden: Row, found: Row) -> list[str]:
    """Where an episode is farther off than another renderer explains; nothing is compared of a case not in NEAR."""
    off = []
    for place, most in NEAR[name].get(key.rpartition("/")[0], {}).items():
        was, now = (reduce(getitem, place.split("."), row) for row in (golden, found))
        if np.any(np.abs(np.subtract(was, now, dtype=float)) > most):
            off.append(f"{place} was {was!r} and is {now!r}")
    return off


def main() -> int:
    """Check, or write."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("verb", choices=("check", "write"))
    parser.add_argument("names", nargs="*", metavar="name", help=f"of {', '.join(NAMES)} (default: all)")
    parser.add_argument("--starts", type=int, default=None, help="of each case")
    parser.add_argument("--every", type=int, default=None, metavar="N", help="only each Nth (default: 3)")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    arguments = parser.parse_args()
    if unknown := set(arguments.names) - set(NAMES):
        parser.error(f"no golden episodes are named {', '.join(sorted(unknown))}; there are: {', '.join(NAMES)}")
    names = arguments.names or list(NAMES)
    if arguments.verb == "check":
        starts, every = arguments.starts or 1, arguments.every or 3
        return report(run_all(names, starts, every, arguments.workers, written=True))
    for name, rows in run_all(names, arguments.starts or STARTS, arguments.every or 1, arguments.workers).items():
        write(name, rows)
    return 0


def report(found: Mapping[str, Mapping[str, Row]]) -> int:
    """Print which episodes have moved; 1 where any has."""
    here, moved, compared = fingerprint(), 0, 0
    for name, rows in found.items():
        platform_of_golden, kept = read(name)
        for key, row in rows.items():
            same = platform_of_golden == here
            places = differing(kept[key], row) if same else far_off(name, key, kept[key], row)
            compared += same or key.rpartition("/")[0] in NEAR[name]
            if places:
                moved += 1
                print(f"{name} {key}", *places[:6], sep="\n  ")
        if platform_of_golden != here:
            others = [f"{what} {platform_of_golden.get(what)}, here {here[what]}" for what in here
                      if platform_of_golden.get(what) != here[what]]  # fmt: skip
            print(f"{name}: written on another platform ({'; '.join(others)}), and compared within tolerances")
    print(f"{compared - moved} of {compared} episodes are as they were")
    return int(moved > 0)


if __name__ == "__main__":
    sys.exit(main())
