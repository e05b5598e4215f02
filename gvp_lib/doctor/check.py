"""What a check finds, and where a clone keeps what the checks read.

Every check is a function of nothing that returns a :class:`Check`; what it finds, however bad, is no exception.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

__all__ = ["CLONE", "SETUP", "Check", "in_clone"]

CLONE = Path(__file__).resolve().parents[2]  # the folder of gvp_lib: a clone, or else site-packages
SETUP = "environment/setup.sh"


@dataclass(frozen=True, slots=True)
class Check:
    """What was found about one need.

    Attributes
    ----------
    name
        The need.
    ok
        True: met. False: not met, and something will not work. None: optional, and absent.
    detail
        What was found, in a line.
    mend
        What to do about it; empty where nothing need be done.
    """

    name: str
    ok: bool | None
    detail: str
    mend: str = ""

    def __str__(self) -> str:
        mark = {True: "[OK]  ", False: "[FAIL]", None: "[ -- ]"}[self.ok]
        line = f"{mark} {self.name:<10} {self.detail}"
        return f"{line}\n{'':<17} mend: {self.mend}" if self.mend else line


def in_clone() -> bool:
    """Whether this package runs from a clone, which has a lock, or from a wheel, which has none."""
    return (CLONE / "environment/lock.txt").is_file() and (CLONE / "pyproject.toml").is_file()
