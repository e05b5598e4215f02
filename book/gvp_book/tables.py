"""Tables and figures, the thesis's and ours: ``gvp reproduce NAME`` computes one and stores it for the book."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from gvp_book.experiments import alignment, desk, grasping, learned, objects, outlines, reach
from gvp_book.experiments.networks import gpu_at_hand
from gvp_book.results import Settings
from gvp_lib.errors import InvalidParameterError, UnknownNameError

TABLES: Mapping[str, Callable[[str, Settings], Path]] = {
    "table-3.1": alignment.EXPERIMENT,
    "table-3.2": grasping.EXPERIMENT,
    **learned.TABLES,
    "reach": reach.EXPERIMENT,
    "outlines": outlines.EXPERIMENT,
    "objects": objects.EXPERIMENT,
    "photographs": desk.EXPERIMENT,
}
"""What can be reproduced, by name."""

SEEDS: Mapping[str, int] = dict.fromkeys(TABLES, 2020) | {"objects": objects.SEED}
"""Seeds of all starts of the stored results."""


def reproduce(name: str, settings: Settings) -> Path:
    """Compute a table or figure of the thesis and store it; an interrupted run resumes where it stopped.

    Returns the file written. Raises UnknownNameError if there is no such table; InvalidParameterError if ResNet-50 is
    requested without a GPU, or for a table that does not use it, or objects of one's own for another than "objects";
    and GvpError if some episodes failed, which is a bug in the program. The journal keeps the episodes that did not
    fail.
    """
    if name not in TABLES:
        raise UnknownNameError("table or figure", name, TABLES)
    if settings.resnet50 and name not in learned.WITH_RESNET50:
        known = ", ".join(learned.WITH_RESNET50)
        raise InvalidParameterError(f"ResNet-50 is for {known}; {name} is the same without --resnet50")
    if settings.resnet50 and not gpu_at_hand():
        raise InvalidParameterError(
            "ResNet-50 is trained on a GPU, and none is at hand here. Without --resnet50 the small networks are "
            "trained, on a processor too"
        )
    if settings.objects and name != "objects":
        raise InvalidParameterError(f"objects of your own join the experiment 'objects'; {name} has none of them")
    if settings.objects:
        name, experiment = objects.with_own(settings.objects, settings.scale)
        return experiment(name, settings)
    return TABLES[name](name, settings)
