"""The learned planner: where it ends, on known objects and on new ones, and whether it keeps up with a moving one.
Tables 3.3 and 3.4, Figs. 3.3 and 3.4, and what goes beyond them. Thesis 2.4, 2.4.5, 3.2, 3.2.1, 3.2.2, 3.2.3.

Each episode draws one start on the virtual sphere, from which each method runs in turn.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from gvp_book.experiments.networks import ALL, CLOSER, FEW, TRIALS, prepared
from gvp_book.results import EPISODES, Row, Settings, by_case, noise_fields, run_episodes, store
from gvp_lib.errors import GvpError
from gvp_lib.evaluation.baselines import Stay
from gvp_lib.evaluation.episodes import Start, begin_again, draw_start, run_episode
from gvp_lib.evaluation.statistics import paired_difference, summarize
from gvp_lib.learning.checkpoints import weights_file
from gvp_lib.learning.labels import label_view
from gvp_lib.learning.policy import NetworkPolicy, on_threads
from gvp_lib.learning.recipe import Painter, Variation
from gvp_lib.perception.segmentation import Saliency
from gvp_lib.planning.learned import CnnPlanner
from gvp_lib.planning.plan import Action, ViewpointPlanner
from gvp_lib.simulation.moving import Path as MotionPath
from gvp_lib.simulation.moving import Rocking, Sliding, Turning, moving_target
from gvp_lib.simulation.objects import BLUE, OBJECTS, ObjectSpec, brick_mjcf
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import CellCache, WorkCell

THESIS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "table-3.3": {"cuboid_1x2": (4.5, 2.7), "tomato_soup_box": (8.6, 4.8)},
    "table-3.4": {"cuboid_1x1": (4.3, 2.89), "cuboid_1x3": (6.8, 4.3), "cylinder": (61.5, 12.3)},
}
"""As printed: mean and standard deviation of the final error, deg, over 50 trials."""

INPUTS = "the first pictures of its networks' sets and one forward pass of each: they do not come with the library"
IN_PART = f"{EPISODES}; of networks that do not come with the library, the first pictures and one forward pass"
"""What is run again of a result that rests on networks."""

RADIUS = 0.5  # m, of the virtual sphere: one scale for all objects
CAP = (0.0, 30.0)  # deg, of the starts, as of the data sets


# --- where they begin -------------------------------------------------------------------------------------------------


class VariedCell:
    """Work cell whose appearance is drawn anew for each start."""

    def __init__(self, cell: WorkCell, variation: Variation) -> None:
        self.cell, self.variation = cell, variation
        self._painter, self._painted = Painter(cell, variation), cell.model

    def paint(self, rng: np.random.Generator) -> None:
        """Draw a new appearance, if anything varies."""
        if self._painted is not self.cell.model:  # a scene that was compiled anew looks as at first
            self._painter, self._painted = Painter(self.cell, self.variation), self.cell.model
        self._painter.paint(rng)

    def close(self) -> None:
        """Free the cell's graphics contexts."""
        self.cell.close()


def cell_of(job: Mapping[str, Any]) -> VariedCell:
    """Work cell of a job. The last one is cached, since jobs of one case follow each other."""
    target, noise, variation = job["target"], Noise(**job["noise"]), Variation(**job["variation"])
    key = target, tuple(sorted(job["noise"].items())), tuple(sorted(job["variation"].items()))
    return _kept.get(key, lambda: VariedCell(WorkCell("ur5e", spec_of(target), noise=noise), variation))


_kept: CellCache[VariedCell] = CellCache()


def spec_of(target: str) -> ObjectSpec:
    """Object by name, or a brick painted like the 1x2, as in ``"cuboid_1x1 in blue"``.

    Whether the thesis's bricks all had one color in its simulator is not known; to a network, it makes all the
    difference.
    """
    name, _, paint = target.partition(" in ")
    if not paint:
        return OBJECTS[name]
    mjcf = brick_mjcf(int(name.removeprefix("cuboid_1x")), BLUE)
    return replace(OBJECTS[name], mjcf=mjcf, segmenter=OBJECTS["cuboid_1x2"].segmenter)


def begin(varied: VariedCell, job: Mapping[str, Any]) -> Start:
    """Set up an episode, with the same places for every noise and method."""
    case = zlib.crc32(job["target"].encode())
    for attempt in range(20):
        places, draws, look = np.random.SeedSequence([job["seed"], case, job["k"], attempt]).spawn(3)
        varied.cell.reset(places)
        varied.paint(np.random.default_rng(look))
        try:
            rng = np.random.default_rng(draws)
            return draw_start(varied.cell, rng, CAP, distances=(RADIUS, RADIUS), radius=RADIUS, by_area=True)
        except GvpError:
            continue
    raise GvpError(f"no place within reach for {job['target']!r}, start {job['k']}")


# --- where they end ---------------------------------------------------------------------------------------------------


def step_over_once(job: Mapping[str, Any]) -> Row:
    """Run one episode: from one start, the judgement of each method (angles in deg), with its number of ``steps``.

    A job has ``target``, as :func:`spec_of` knows it; ``noise`` (fields of :class:`Noise`); ``variation`` (fields of
    :class:`Variation`); ``seed``; ``k``, the number of the start; and ``methods``, by name: ``stay`` (center and stay),
    ``chance`` (actions at random until NO_OP), ``oracle`` (the best action each time, which is what labels are made
    of), or ``weights`` (the path of a file, or of several, of which start k takes number k modulo their number),
    ``turns``, ``salient`` (whether the object is found by what stands out from the border of the picture, rather than
    by its color) and ``planner`` (fields of :class:`CnnPlanner`).
    """
    varied = cell_of(job)
    cell = varied.cell
    start = begin(varied, job)
    row: Row = {"start": {"tilt": float(np.degrees(start.tilt)), "tries": start.tries}}
    for name, method in job["methods"].items():
        begin_again(cell, start)
        with on_threads(1):
            plan, judged = run_episode(cell, _method(name, method, cell, job))
        row[name] = judged.to_dict() | {"steps": len(plan.steps)}
    return row


def _method(name: str, method: Mapping[str, Any], cell: WorkCell, job: Mapping[str, Any]) -> ViewpointPlanner:
    if name == "stay":
        return Stay(cell.segmenter)
    options = method.get("planner", {})
    rng = np.random.default_rng([job["seed"], zlib.crc32(job["target"].encode()), job["k"]])

    def chance(rgb: Any) -> Action:
        return Action(int(rng.integers(len(Action))))

    def oracle(rgb: Any) -> Action:
        step = options.get("step", np.radians(5))
        return label_view(cell.truth.world_from_camera, cell.truth.normal, step).action

    policy: Callable[[Any], Any] = chance if name == "chance" else oracle
    if files := _listed(method.get("weights", [])):
        policy = policy_of(files[job["k"] % len(files)], method.get("turns", 1))
    segmenter = Saliency() if method.get("salient") else cell.segmenter
    return CnnPlanner(segmenter, policy, radius=RADIUS, **options)


def policy_of(weights: str, tta: int) -> NetworkPolicy:
    """A network as a policy; kept, since episodes of one network follow each other, until its file is another."""
    file = weights_file(weights)
    found = file.stat() if file.is_file() else None
    return _policy_of(weights, tta, found and (found.st_mtime_ns, found.st_size))


@lru_cache(maxsize=32)
def _policy_of(weights: str, tta: int, version: tuple[int, int] | None) -> NetworkPolicy:
    return NetworkPolicy(weights, tta=tta)


# --- an object that moves ---------------------------------------------------------------------------------------------

PAUSE = 0.1  # s, that a picture and a network's answer take
SETTLED = 15  # looks, after which a planner that starts anywhere on the cap has arrived
WATCHED = 5.0  # s, for which it is watched from then on; a rocking object for a whole period

PATHS: Mapping[str, MotionPath] = {
    "still": Sliding((0.0, 0.0)),
    **{f"slides at {speed:g} mm/s": Sliding((0.0, speed / 1000)) for speed in (5, 10, 20)},
    **{f"turns at {rate:g} deg/s": Turning(np.radians(rate)) for rate in (5, 20)},
    **{f"rocks by 10 deg in {period:g} s": Rocking(np.radians(10), period) for period in (20, 10, 5, 2.5)},
}
"""How the object moves; a rocking one's normal swings by 10 deg to either side."""


def follow_once(job: Mapping[str, Any]) -> Row:
    """From one start, let each method follow the object, for :data:`SETTLED` looks and the seconds after them.

    A job is as for :func:`step_over_once`, with a ``path`` in :data:`PATHS`. For each method: ``error``, the mean over
    the looks after the first :data:`SETTLED`, deg; ``lost``, whether the object was out of sight at any of these;
    ``seconds`` for each look.
    """
    varied, path = cell_of(job), PATHS[job["path"]]
    cell = varied.cell
    watched = path.period if isinstance(path, Rocking) else WATCHED
    row: Row = {}
    for name, method in job["methods"].items():
        begin(varied, job)
        policy = policy_of(method["weights"], method.get("turns", 1))
        planner = CnnPlanner(cell.segmenter, policy, radius=RADIUS, **method.get("planner", {}))
        began, until = cell.time, np.inf
        errors: list[float] = []
        lost: list[bool] = []
        with on_threads(1), moving_target(cell, path):
            for step in planner.steps(cell.arm):
                cell.wait(PAUSE)
                errors.append(float(np.degrees(cell.truth.viewpoint_error())))
                lost.append(step.view is None)
                if len(errors) == SETTLED:
                    until = cell.time + watched
                if cell.time >= until:
                    break
        row[name] = {
            "error": float(np.mean(errors[SETTLED:])),
            "lost": any(lost[SETTLED:]),
            "seconds": (cell.time - began) / len(errors),
        }
    return row


# --- what is run ------------------------------------------------------------------------------------------------------

STARTS, FEWER, FOLLOWED = 200, 20, 10

_CONDITIONS: Mapping[str, Row] = {
    "clean": {"noise": {}, "variation": {}},
    "rough": {"noise": noise_fields(Noise.thesis()), "variation": {"light": 0.4}},
}


def _at(step: float) -> Row:
    return {"step": float(np.radians(step))}


_BASELINES: Row = {"stay": {}, "chance": {}, "oracle": {}}
_STEPS: Row = {
    **{f"{step:g} deg steps": {"network": f"1x2-random-{step:g}deg", "planner": _at(step)} for step in (2.5, 10)},
    **{f"oracle, {step:g} deg steps": {"planner": _at(step)} for step in (2.5, 10)},
}
IN_BLUE = ("cuboid_1x1 in blue", "cuboid_1x3 in blue")
OTHERS = (*IN_BLUE, "cuboid_1x1", "cuboid_1x3", "cylinder")
"""Objects of Table 3.4: the bricks in the color of the 1x2, on which ResNet-50 of pictures that are not resized is
tried as well, and in their own."""
_OF_1X2: Row = {"random": {"network": "1x2-random-0"}, "uniform": {"network": "1x2-uniform-0"}}
_SHARP: Row = {"network": "1x2-sharp"}
"""The thesis's planner, but for the picture that it crops: not resized to half its size."""
_AS_LARGE = "ResNet-50, 128 px"
_OURS: Row = {"turns": 8, "planner": {"stop_at_reversal": True}}
"""Five actions still, of a picture that is not resized but shown in eight ways; a reversal ends the plan as NO_OP."""


def learned_jobs(name: str, seed: int, starts: int, *, large: bool = False) -> dict[str, Row]:
    """Jobs of all episodes of a table, with keys ``group/target/k``, and with networks by name rather than by file.

    ``clean`` is without noise, as in the thesis's simulator; ``rough`` has the noise of ``Noise.thesis()`` and light
    that varies by 40 % from start to start. With ``large``, ResNet-50 is among the networks of the thesis's tables.
    """
    if name == "table-3.3":
        cases = [("clean", "cuboid_1x2", {
            **_OF_1X2, **_BASELINES,
            "ten trainings": {"network": [f"1x2-random-{k}" for k in range(TRIALS)]},
            "sgd": {"network": [f"1x2-random-sgd-{k}" for k in range(FEW)]},
            "random, 128 px": _SHARP, "random, ensured": {"network": "1x2-random-0", **_OURS},
            "ours": {"network": "1x2-turned", **_OURS}, **_STEPS, **(_large("1x2", TRIALS) if large else {}),
        }), ("clean", "tomato_soup_box", {
            "random": {"network": "soup-random-0"}, "uniform": {"network": "soup-uniform-0"}, **_BASELINES,
            "ours": {"network": "soup-turned", **_OURS}, **(_large("soup") if large else {}),
        })]  # fmt: skip
    elif name == "table-3.4":
        methods = {**_OF_1X2, **_BASELINES, "random, 128 px": _SHARP, "any color": {"network": "1x2-colors"},
                   "ours": {"network": "1x2-turned", **_OURS},
                   "ours, any color": {"network": "1x2-colors", **_OURS}}  # fmt: skip
        cases = [("clean", target, methods | (_large("1x2", sharp=target in IN_BLUE) if large else {}))
                 for target in OTHERS]  # fmt: skip
    else:
        cases = [(group, target, _heads(group, target) if name == "direction-head" else _ABLATED)
                 for group in _CONDITIONS for target in ALL]  # fmt: skip
    return {
        f"{group}/{target}/{k}": {**_CONDITIONS[group], "target": target, "seed": seed, "k": k, "methods": methods}
        for group, target, methods in cases
        for k in range(starts)
    }


def _large(of: str, trials: int = 1, *, sharp: bool = True) -> Row:
    """The thesis's ResNet-50, from each of an object's sets; with ``sharp``, of pictures not resized as well. With many
    ``trials``, as often from the first set, and once from each that is drawn closer to the normal."""
    names = ("random", "uniform")
    rows: Row = {f"{name}, ResNet-50": {"network": f"{of}-{name}-resnet50-64px"} for name in names}
    if sharp:
        rows |= {f"{name}, {_AS_LARGE}": {"network": f"{of}-{name}-resnet50-0"} for name in names}
    if trials > 1:
        every = [f"{of}-random-resnet50-{k}" for k in range(trials)]
        rows |= {f"ten trainings, {_AS_LARGE}": {"network": every}}
        rows |= {f"sigma {sigma} deg, ResNet-50": {"network": f"{of}-sigma-{sigma}-resnet50-64px"} for sigma in CLOSER}
    return rows


def _head(network: str) -> Row:
    """A direction head that is shown each picture in eight ways, of an object that is found without its color."""
    return {"network": network, "turns": 8, "salient": True}


def _heads(group: str, target: str) -> Row:
    """One direction head for all objects, and that of the object itself beside the thesis's policy; in the rough, also
    what becomes of it where the object is found by thresholds of color, as the thesis does."""
    by_color: Row = {"all, by color": {"network": "tilt-all", "turns": 8}} if group == "rough" else {}
    own: Row = {"own": _head("tilt-1x2"), **_OF_1X2} if target == "cuboid_1x2" else {}
    return {"all": _head("tilt-all")} | by_color | own


_ONE: Row = {"survey": 0}
_ABLATED: Row = {name: _head(name) for name in ("plain", "plain-turned", "varied-turned")} | {
    "varied-turned, no survey": _head("varied-turned") | {"planner": _ONE}
}
_FOLLOWERS: Row = {
    "actions": {"weights": "actions-1x2"},
    "tilt": {"weights": "tilt-1x2", "turns": 8, "planner": _ONE},
}
"""Networks that come with the library."""


def following_jobs(seed: int, starts: int) -> dict[str, Row]:
    """Jobs of all episodes with a moving object, with keys ``path/k``."""
    job = {**_CONDITIONS["clean"], "target": "cuboid_1x2", "seed": seed}
    return {
        f"{path}/{k}": {**job, "k": k, "path": path, "methods": _FOLLOWERS} for path in PATHS for k in range(starts)
    }


def _table(name: str, settings: Settings) -> Path:
    starts = settings.starts or (STARTS if name != "augmentation" else FEWER)
    jobs = learned_jobs(name, settings.seed, starts, large=settings.resnet50)
    networks = prepared(_networks(jobs), settings)

    def status(rows: Sequence[Row]) -> str:
        first = [next((name, row[name]["total"]) for name in row if name != "start") for row in rows]
        return f"{first[-1][0]}: mean {np.mean([total for _, total in first]):.2f} deg"

    rows = run_episodes(
        name, step_over_once, _with_weights(jobs, networks), settings,
        recipe=_recipe(jobs, networks, settings), status=status,
    )  # fmt: skip
    return store(name, settings, starts, episodes_report(name, rows, networks), IN_PART)


def _following(name: str, settings: Settings) -> Path:
    starts = settings.starts or FOLLOWED
    jobs = following_jobs(settings.seed, starts)
    shipped = {each: {"sha256": sha256(weights_file(each).read_bytes()).hexdigest()}
               for each in (method["weights"] for method in _FOLLOWERS.values())}  # fmt: skip
    rows = run_episodes(name, follow_once, jobs, settings, recipe=_recipe(jobs, shipped, settings))
    return store(name, settings, starts, following_report(rows))


def _curves(name: str, settings: Settings) -> Path:
    trials = min(settings.starts or TRIALS, TRIALS)
    curves = {"random adamw": ("1x2-random", trials), "uniform adamw": ("1x2-uniform", min(trials, FEW)),
              "random sgd": ("1x2-random-sgd", min(trials, FEW)),
              **({_AS_LARGE: ("1x2-random-resnet50", trials)} if settings.resnet50 else {})}  # fmt: skip
    names = {f"{curve}/{k}": f"{network}-{k}" for curve, (network, n) in curves.items() for k in range(n)}
    done = prepared(names.values(), settings)
    split = "" if name == "figure-3.3" else "validation_"
    content = curves_report(split, {key: done[network] for key, network in names.items()})
    return store(name, settings, trials, content, INPUTS)


def _listed(network: str | list[str]) -> list[str]:
    return [network] if isinstance(network, str) else network


def _networks(jobs: Mapping[str, Row]) -> list[str]:
    """Names of all networks that some jobs use, each once."""
    methods = (method for job in jobs.values() for method in job["methods"].values())
    return list(dict.fromkeys(name for method in methods for name in _listed(method.get("network", []))))


def _with_weights(jobs: Mapping[str, Row], networks: Mapping[str, Row]) -> dict[str, Row]:
    """Jobs with the files of their networks' weights."""

    def found(method: Row) -> Row:
        return {**method, "weights": [networks[name]["weights"] for name in _listed(method.get("network", []))]}

    return {
        key: {**job, "methods": {name: found(method) for name, method in job["methods"].items()}}
        for key, job in jobs.items()
    }


def _recipe(jobs: Mapping[str, Row], networks: Mapping[str, Row], settings: Settings) -> Row:
    """What the episodes depend on besides their keys: the weights to the bit, but not where they lie."""
    return {
        "seed": settings.seed,
        "jobs": {key: job for key, job in jobs.items() if job["k"] == 0},
        "weights": {name: network["sha256"] for name, network in networks.items()},
    }


WITH_RESNET50 = ("figure-3.3", "figure-3.4", "table-3.3", "table-3.4")
"""Those that may have the thesis's ResNet-50 among their networks."""

TABLES: Mapping[str, Callable[[str, Settings], Path]] = {
    "figure-3.3": _curves,
    "figure-3.4": _curves,
    "table-3.3": _table,
    "table-3.4": _table,
    "direction-head": _table,
    "augmentation": _table,
    "moving-object": _following,
}
"""What can be reproduced, by name; the last three are ours."""

# --- what it adds up to -----------------------------------------------------------------------------------------------


def episodes_report(name: str, rows: Mapping[str, Row], networks: Mapping[str, Row]) -> Row:
    """Content of a table's stored result; angles in deg.

    It is made from rows of :func:`step_over_once` with keys ``group/target/k``, in order of k, and networks as
    :func:`gvp_book.experiments.networks.prepared` returns them. ``thesis``: the printed table. ``networks``: what each
    is, with the hash of its weights. ``summary``: by group and target, for each method: the final ``error``; its
    ``change`` from the start, negative where it fell; ``steps`` until the plan ended; ``outcomes``; and of each method
    ``a`` but the first, ``b``, the paired difference ``a - b``. ``rows``: every episode.
    """
    cases = by_case(rows)
    return {
        "thesis": {target: {"mean": mean, "sd": sd} for target, (mean, sd) in THESIS.get(name, {}).items()},
        "networks": {network: _network(made) for network, made in networks.items()},
        "summary": {case: _summary(group) for case, group in cases.items()},
        "rows": {case: _columns(group) for case, group in cases.items()},
    }


def _summary(group: Sequence[Row]) -> Row:
    tilts = np.array([row["start"]["tilt"] for row in group])
    first, *others = (name for name in group[0] if name != "start")
    totals = {name: np.array([row[name]["total"] for row in group]) for name in (first, *others)}
    summary: Row = {"start": summarize(tilts)}
    for name, errors in totals.items():
        ends = [row[name]["outcome"] for row in group]
        summary[name] = {
            "error": summarize(errors),
            "change": summarize(errors - tilts),
            "steps": summarize([row[name]["steps"] for row in group]),
            "frames": float(np.mean([row[name]["frames"] for row in group])),
            "seconds": float(np.mean([row[name]["seconds"] for row in group])),
            "outcomes": {end: ends.count(end) for end in dict.fromkeys(ends)},
        }
    for name in others:
        summary[f"{name} - {first}"] = paired_difference(totals[name], totals[first])
    return summary


def _columns(group: Sequence[Row]) -> Row:
    """Every episode of a case, column by column and to a hundredth, so that thousands stay a small file."""
    table: Row = {"tilt": [round(row["start"]["tilt"], 2) for row in group]}
    for name in (name for name in group[0] if name != "start"):
        table[name] = {
            "error": [round(row[name]["total"], 2) for row in group],
            "steps": [row[name]["steps"] for row in group],
            "outcome": [row[name]["outcome"] for row in group],
        }
    return table


def _network(made: Row) -> Row:
    last = made["history"][-1]
    return {
        **made["about"],
        "sha256": made["sha256"],
        "epochs": len(made["history"]),
        **{name: last[name] for name in last if name.startswith("validation")},
        "minutes": sum(line["seconds"] for line in made["history"]) / 60,
    }


def following_report(rows: Mapping[str, Row]) -> Row:
    """Content by path and method: mean error while following, deg, and number of episodes that lost the object."""
    summary: Row = {}
    for path, group in by_case(rows).items():
        summary[path] = {
            method: {
                "error": summarize([row[method]["error"] for row in group]),
                "lost": sum(row[method]["lost"] for row in group),
                "seconds": float(np.mean([row[method]["seconds"] for row in group])),
            }
            for method in group[0]
        }
    return {"summary": summary}


def curves_report(split: str, networks: Mapping[str, Row]) -> Row:
    """Curves of a figure: mean and spread over the trainings, epoch by epoch; trainings have keys ``curve/number``.

    The split is ``""``, for the training set while the weights change, or ``"validation_"``.
    """
    curves: Row = {}
    for curve, group in by_case(networks).items():
        histories = [training["history"] for training in group]
        seconds = float(np.median([line["seconds"] for history in histories for line in history]))
        curves[curve] = {"n": len(group), **group[-1]["about"], "seconds_per_epoch": seconds}
        for name in ("accuracy", "loss"):
            values = np.array([[line[split + name] for line in history] for history in histories])  # (n, epochs)
            curves[curve][name] = {
                "mean": values.mean(axis=0),
                "sd": values.std(axis=0, ddof=1) if len(values) > 1 else np.zeros(values.shape[1]),
                "all": values,
            }
    return {"curves": curves}
