"""``gvp doctor``: what this machine has and lacks for the book, each lack with its mend."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from gvp_lib.doctor.check import Check
from gvp_lib.doctor.machine import check_disk, check_gpu, check_jupyter, check_port, check_python
from gvp_lib.doctor.packages import check_packages
from gvp_lib.doctor.rendering import check_rendering
from gvp_lib.errors import UnknownNameError

__all__ = ["CHECKS", "Check", "examine"]

CHECKS: dict[str, Callable[[], Check]] = {
    "python": check_python,
    "packages": check_packages,
    "rendering": check_rendering,
    "port": check_port,
    "disk": check_disk,
    "gpu": check_gpu,
    "jupyter": check_jupyter,
}


def examine(needs: Iterable[str] = ()) -> int:
    """Print what is found about each need.

    Parameters
    ----------
    needs
        Names of `CHECKS`; all of them where none is given.

    Returns
    -------
    int
        0 if nothing failed, else 1: an exit status.

    Raises
    ------
    UnknownNameError
        For a need that is not one of `CHECKS`.
    """
    needs = list(needs) or list(CHECKS)
    for name in needs:
        if name not in CHECKS:
            raise UnknownNameError("need", name, CHECKS)
    failed = 0
    for name in needs:
        found = CHECKS[name]()
        failed += found.ok is False
        print(found, flush=True)
    return 1 if failed else 0
