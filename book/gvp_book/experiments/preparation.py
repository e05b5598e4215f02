"""Data sets and networks that experiments share: made once, found by all. Thesis 2.4.2 to 2.4.4."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from gvp_book.experiments.networks import NETWORKS, SETS, train_once
from gvp_book.running import Settings, cluster
from gvp_lib.errors import GvpError
from gvp_lib.jobs import run_jobs
from gvp_lib.learning.collect import collect_dataset

__all__ = ["prepared"]


def prepared(names: Iterable[str], settings: Settings) -> dict[str, dict[str, Any]]:
    """Collect the sets and train the networks that are not there yet, under ``settings.work``.

    The workers of a Dask cluster read the sets and write the networks there: they share this disk, under the same path.

    Returns
    -------
    dict
        For each network its ``history``, the ``sha256`` of its weights, ``weights``, the path of their file, and
        ``about``: the ``network``'s name, the ``size`` of its pictures, px, and the ``device`` that trained it.
    """
    names, work = list(dict.fromkeys(names)), settings.work.resolve()  # a worker may run in another folder
    for name in dict.fromkeys(each for network in names for each in NETWORKS[network].sets):
        collect_dataset(work / "sets" / name, SETS[name], workers=settings.workers, progress=settings.progress)
    jobs = {name: {"name": name, "work": str(work)} for name in names}
    with cluster(settings) as executor:
        results = run_jobs(
            train_once, jobs, executor=executor, workers=settings.workers, progress=settings.progress, title="train"
        )
    for name, result in results.items():
        if result.failed:
            raise GvpError(f"network {name!r} could not be trained; the same command goes on:\n{result.error}")
    return {name: result.value for name, result in results.items()}
