"""The tables and figures of the learned planner, by name: Tables 3.3 and 3.4, Figs. 3.3 and 3.4, and what goes beyond
them. Thesis 3.2."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from gvp_book.experiments.following import PATHS, follow_once
from gvp_book.experiments.learned import step_over_once
from gvp_book.experiments.learned_report import curves_report, episodes_report, following_report
from gvp_book.experiments.networks import ALL, CLOSER, FEW, TRIALS
from gvp_book.experiments.preparation import prepared
from gvp_book.running import EPISODES, Settings, run_episodes, store
from gvp_lib.learning.checkpoints import weights_file
from gvp_lib.simulation.sensors import Noise

__all__ = ["TABLES", "WITH_RESNET50", "following_jobs", "learned_jobs"]

Row = dict[str, Any]

INPUTS = "the first pictures of its networks' sets and one forward pass of each: they do not come with the library"
IN_PART = f"{EPISODES}; of networks that do not come with the library, the first pictures and one forward pass"
"""What is run again of a result that rests on networks."""

STARTS, FEWER, FOLLOWED = 200, 20, 10

_BARE: Row = {"noise": {}, "variation": {}}
_THESIS_NOISE = {name: float(getattr(Noise.thesis(), name)) for name in Noise.__dataclass_fields__}
_ROUGH: Row = {"noise": {k: v for k, v in _THESIS_NOISE.items() if v}, "variation": {"light": 0.4}}


def _at(step: float) -> Row:
    return {"step": float(np.radians(step))}


_BASELINES: Row = {"stay": {}, "chance": {}, "oracle": {}}
_STEPS: Row = {
    **{f"{step:g} deg steps": {"network": f"1x2-random-{step:g}deg", "planner": _at(step)} for step in (2.5, 10)},
    **{f"oracle, {step:g} deg steps": {"planner": _at(step)} for step in (2.5, 10)},
}
IN_BLUE = ("cuboid_1x1 in blue", "cuboid_1x3 in blue")
OTHERS = (*IN_BLUE, "cuboid_1x1", "cuboid_1x3", "cylinder")
"""Objects of Table 3.4: the bricks in the color of the 1x2, on which ResNet-50 of pictures that are not shrunk is tried
as well, and in their own."""
_OF_1X2: Row = {"random": {"network": "1x2-random-0"}, "uniform": {"network": "1x2-uniform-0"}}
_SHARP: Row = {"network": "1x2-sharp"}
"""The thesis's planner, but for the picture that it crops: not shrunk to half its size."""
_OURS: Row = {"turns": 8, "planner": {"stop_at_reversal": True}}
"""Five actions still, of a picture that is not shrunk but shown in eight ways; a reversal ends the plan as NO_OP."""


def learned_jobs(name: str, seed: int, starts: int, *, large: bool = False) -> dict[str, Row]:
    """Every episode of a table under keys ``group/target/k``, with networks by name rather than by file.

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
                 for group in ("clean", "rough") for target in ALL]  # fmt: skip
    return {
        f"{group}/{target}/{k}": {
            **(_ROUGH if group == "rough" else _BARE),
            "target": target, "seed": seed, "k": k, "methods": methods,
        }
        for group, target, methods in cases
        for k in range(starts)
    }  # fmt: skip


_AS_LARGE = "ResNet-50, 128 px"


def _large(of: str, trials: int = 1, *, sharp: bool = True) -> Row:
    """The thesis's ResNet-50, from each of an object's sets; with ``sharp``, of pictures not shrunk as well. With many
    ``trials``, as often from the first set, and once from each that is drawn closer to the normal."""
    names = ("random", "uniform")
    rows: Row = {f"{name}, ResNet-50": {"network": f"{of}-{name}-resnet50-64px"} for name in names}
    if not sharp:
        return rows
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
    """Every episode of the moving object under keys ``path/k``."""
    return {
        f"{path}/{k}": {
            **_BARE, "target": "cuboid_1x2", "seed": seed, "k": k, "path": path, "methods": _FOLLOWERS
        }
        for path in PATHS
        for k in range(starts)
    }  # fmt: skip


def _table(name: str, settings: Settings) -> Path:
    starts = settings.starts or (STARTS if name != "augmentation" else FEWER)
    jobs = learned_jobs(name, settings.seed, starts, large=settings.resnet50)
    networks = prepared(_networks(jobs), settings)
    errors: list[float] = []

    def tell(row: Row) -> str:
        method = next(method for method in row if method != "start")
        errors.append(row[method]["total"])
        return f"{method}: mean {np.mean(errors):.2f} deg"

    rows = run_episodes(
        name, step_over_once, _with_weights(jobs, networks), settings,
        recipe=_recipe(jobs, networks, settings), tell=tell,
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


def _networks(jobs: Mapping[str, Row]) -> list[str]:
    """Names of all networks that some jobs use, each once."""
    used: dict[str, None] = {}
    for job in jobs.values():
        for method in job["methods"].values():
            network = method.get("network", [])
            used |= dict.fromkeys([network] if isinstance(network, str) else network)
    return list(used)


def _with_weights(jobs: Mapping[str, Row], networks: Mapping[str, Row]) -> dict[str, Row]:
    """Jobs with the files of their networks' weights."""

    def found(method: Row) -> Row:
        name = method.get("network")
        if name is None:
            return method
        files = networks[name]["weights"] if isinstance(name, str) else [networks[each]["weights"] for each in name]
        return {**method, "weights": files}

    return {
        key: {**job, "methods": {name: found(method) for name, method in job["methods"].items()}}
        for key, job in jobs.items()
    }


def _recipe(jobs: Mapping[str, Row], networks: Mapping[str, Row], settings: Settings) -> Row:
    """What the episodes depend on besides their keys: the weights to the bit, but not where they lie."""
    return {
        "seed": settings.seed,
        "jobs": {key: job for key, job in jobs.items() if job["k"] == 0},
        "weights": {network: told["sha256"] for network, told in networks.items()},
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
