"""``gvp collect``."""

from __future__ import annotations

import argparse
from typing import Any

from gvp_lib.cli.options import add_where

__all__ = ["add_collect"]


def add_collect(commands: Any) -> None:
    """Declare the command."""
    collect = commands.add_parser(
        "collect",
        help="collect a set of labeled viewpoints",
        description="Collect labeled viewpoints of an object into a folder, as Parquet. A collection that was "
        "interrupted goes on; a set that is finished is checked, and what is damaged is collected again.",
    )
    collect.add_argument("folder", help="where the set goes; made if need be")
    collect.add_argument(
        "--target", default="cuboid_1x2", help="the object: a name, or yours as file.py:NAME (default: cuboid_1x2)"
    )
    collect.add_argument("--placement", default="flat", help="how it stands (default: flat)")
    collect.add_argument("--arm", default="ur5e", help="who holds the camera: ur5e, baxter or floating (default: ur5e)")
    collect.add_argument("--sampling", default="uniform", help="uniform or random (default: uniform)")
    for name, metavar, what in (
        ("n", "N", "samples (default: 4096)"),
        ("rolls", "N", "of a uniform set, at each point (default: 16)"),
        ("crop", "PX", "side of the square that is kept of each picture (default: 128)"),
        ("scenes", "N", "how many times the object is placed anew (default: 1)"),
        ("shard", "N", "samples per file (default: 64)"),
        ("seed", "N", "of everything random (default: 0)"),
    ):
        collect.add_argument(f"--{name}", type=int, metavar=metavar, help=what)
    collect.add_argument("--radius", type=float, metavar="M", help="of the sphere, m (default: 0.5)")
    for name, what in (
        ("max-tilt", "half angle of the cap, deg (default: 30)"),
        ("step", "of the labeled action, deg (default: 5)"),
    ):
        collect.add_argument(f"--{name}", type=float, metavar="DEG", help=what)
    collect.add_argument("--unsorted", action="store_true", help="in the order in which viewpoints are drawn")
    collect.add_argument(
        "--noise", choices=("none", "thesis"), default="none", help="of arm and camera (default: none)"
    )
    for name, what in (
        ("light", "relative strength of the lights, within +-"),
        ("color", "relative brightness of the object, within +-"),
        ("table", "saturation of the table's color, up to"),
        ("size", "relative size of the object, within +-, for each scene"),
    ):
        collect.add_argument(f"--vary-{name}", type=float, default=0.0, metavar="SHARE", help=f"{what} (default: 0)")
    add_where(collect, "collect")
    collect.add_argument("--quiet", action="store_true", help="no progress bar")
    collect.set_defaults(run=_collect)


def own_object(target: str) -> Any:
    """What ``file.py:NAME`` names, imported so that other processes can import it too; any other text as it is.

    Raises
    ------
    InvalidParameterError
        There is no such file, nothing of that name in it, or what it names is no ObjectSpec.
    """
    import sys
    from importlib import import_module
    from pathlib import Path

    from gvp_lib.errors import InvalidParameterError
    from gvp_lib.simulation.objects import ObjectSpec

    place, separator, name = target.rpartition(":")
    if not separator or not place.endswith(".py"):
        return target
    file = Path(place).resolve()
    if not file.is_file():
        raise InvalidParameterError(f"--target file.py:NAME: there is no file {place}")
    sys.path.insert(0, str(file.parent))
    module = import_module(file.stem)
    if Path(module.__file__ or "").resolve() != file:
        raise InvalidParameterError(f"{place} has the name of another module, {module.__name__}; call it otherwise")
    found = getattr(module, name, None)
    if not isinstance(found, ObjectSpec):
        having = ", ".join(key for key, value in vars(module).items() if isinstance(value, ObjectSpec)) or "none"
        raise InvalidParameterError(f"{place} has no ObjectSpec named {name!r}; it has: {having}")
    return found


def _collect(arguments: argparse.Namespace) -> int:
    from contextlib import nullcontext

    import numpy as np

    from gvp_lib.cluster import Place, dask_cluster
    from gvp_lib.errors import InvalidParameterError
    from gvp_lib.experiments.results import source_commit
    from gvp_lib.learning.collection import collect_dataset
    from gvp_lib.learning.recipe import CollectionRecipe
    from gvp_lib.learning.variation import Variation
    from gvp_lib.simulation.sensors import Noise

    if arguments.workers is not None and arguments.workers < 1:
        raise InvalidParameterError(f"--workers is 1 or more; got {arguments.workers}")
    given = {name: getattr(arguments, name) for name in ("n", "rolls", "crop", "scenes", "shard", "seed", "radius")}
    given |= {name: np.radians(v) for name in ("max_tilt", "step") if (v := getattr(arguments, name)) is not None}
    recipe = CollectionRecipe(
        target=own_object(arguments.target),
        placement=arguments.placement,
        arm=arguments.arm,
        sampling=arguments.sampling,
        sort=not arguments.unsorted,
        noise=Noise.thesis() if arguments.noise == "thesis" else Noise.none(),
        variation=Variation(
            **{name: getattr(arguments, f"vary_{name}") for name in ("light", "color", "table", "size")}
        ),
        **{name: value for name, value in given.items() if value is not None},
    )
    here = nullcontext(Place(workers=arguments.workers or 1))
    with here if arguments.dask is None else dask_cluster(arguments.dask, same=source_commit) as place:
        done = collect_dataset(
            arguments.folder, recipe, workers=place.workers, executor=place.executor, progress=not arguments.quiet
        )
    counts = done.card["counts"]
    for name in done.damaged:
        print(f"{name} was missing or damaged and is collected again")
    print(
        f"{done.folder}: {counts['samples']} viewpoints, {done.collected} of them collected now; "
        f"{counts['replaced']} replaced, {counts['frames']} frames, {counts['arm_seconds'] / 60:.1f} min of arm motion"
    )
    return 0
