"""Errors that misuse raises. All descend from :class:`GvpError`, and each says what was given and what would work.

What goes wrong in an episode (a lost target, a joint limit) is data, never an exception: see
:class:`gvp_lib.motion.Outcome`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from ctypes.util import find_library
from difflib import get_close_matches
from shutil import which


class GvpError(Exception):
    """Base class of all errors that ``gvp_lib`` raises on purpose."""


class InvalidParameterError(GvpError, ValueError):
    """A parameter is out of range or malformed."""


class InvalidImageError(GvpError, ValueError):
    """An array is not an image or a mask of the expected form."""


class UnknownNameError(GvpError, LookupError):
    """A name is not in a registry; the message lists the names that are.

    Parameters
    ----------
    kind
        Kind of thing that the name stands for: ``"arm"``, ``"object"``.
    name
        Name as given.
    known
        Names that would have worked.
    """

    def __init__(self, kind: str, name: object, known: Iterable[str]) -> None:
        known = sorted(known)
        close = get_close_matches(str(name), known, n=1)
        hint = f" Did you mean {close[0]!r}?" if close else ""
        super().__init__(f"there is no {kind} named {name!r}.{hint} Known: {', '.join(known)}")
        self.kind, self.name, self.known = kind, name, tuple(known)

    def __reduce__(self) -> tuple[object, ...]:
        # The default would call the class with the finished message alone; errors cross process boundaries.
        return type(self), (self.kind, self.name, self.known)


class ModelError(GvpError, ValueError):
    """An MJCF model lacks what its ``ArmSpec`` or ``ObjectSpec`` names, or does not compile."""


class UnreachableError(GvpError, ValueError):
    """A requested pose has no joint angles within the limits, or none free of collision."""


class MissingExtraError(GvpError, ImportError):
    """A name needs a package that only an optional extra of ``gvp_lib`` installs.

    Parameters
    ----------
    name
        Name that was used.
    package
        Package that is missing.
    extra
        Extra that installs it.
    """

    def __init__(self, name: str, package: str, extra: str) -> None:
        super().__init__(
            f"{name} needs {package}, which is not installed; the extra {extra!r} brings it. Install this package "
            f"again, with [{extra}] behind the folder or file that it came from, as in pip install './gvp_lib[{extra}]'"
        )
        self._given = name, package, extra

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), self._given


class RenderingError(GvpError, ImportError):
    """MuJoCo cannot draw: a library or a screen is missing, or ``MUJOCO_GL`` does not name what draws.

    Parameters
    ----------
    reason
        What is missing.
    mend
        How to mend it; by default, what makes MuJoCo draw on this system.
    """

    def __init__(self, reason: str, mend: str = "") -> None:
        self.reason, self.mend = reason, mend or _how_to_draw(reason)
        super().__init__(f"MuJoCo cannot draw (MUJOCO_GL={_backend()}): {reason}. To mend it: {self.mend}")

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.reason, self.mend)

    @classmethod
    def from_error(cls, error: BaseException) -> RenderingError:
        """Say what an error of MuJoCo, or of its bindings of OpenGL, comes from.

        Parameters
        ----------
        error
            Error raised where MuJoCo was loaded or was to draw.
        """
        error = error.__cause__ or error
        if not isinstance(error, ImportError | RuntimeError):  # of the None that stands for a library that is missing
            needs = {"egl": ("EGL", "GL"), "osmesa": ("OSMesa",)}.get(_backend(), ())
            missing = [f"lib{name}" for name in needs if find_library(name) is None]
            if missing:
                return cls(f"there is no {' and no '.join(missing)}")
        return cls(f"{type(error).__name__}: {str(error).rstrip('.')}")


def _backend() -> str:
    """What ``MUJOCO_GL`` says, as MuJoCo reads it."""
    return os.environ.get("MUJOCO_GL", "").strip().lower()


def _how_to_draw(reason: str) -> str:
    if sys.platform == "darwin":
        return "unset MUJOCO_GL and run in a session logged in on the Mac's own screen"
    if _backend() not in ("", "egl"):
        return "set MUJOCO_GL=egl before Python starts, or unset it"
    if "environment variable" in reason:  # one of those that choose among several of what draws
        return "unset that variable"
    if which("apt-get"):
        return "sudo apt-get install libegl1 libgl1 libgl1-mesa-dri"
    if which("dnf"):
        return "sudo dnf install mesa-libEGL mesa-libGL mesa-dri-drivers"
    return "install Mesa's EGL and DRI drivers (Arch, Alpine: mesa)"


class CalibrationError(GvpError, ValueError):
    """The given pictures or poses do not determine the calibration."""


class JournalError(GvpError, ValueError):
    """A journal of jobs cannot be resumed: it belongs to another recipe, is in use, or is no journal."""


class WorkerDiedError(GvpError, RuntimeError):
    """A worker process or a cluster ended without an answer; finished jobs are in the journal."""


class ClusterError(GvpError, ConnectionError):
    """A cluster cannot be reached, or its workers cannot run the jobs."""


class DownloadError(GvpError, ConnectionError):
    """A published file cannot be downloaded or stored, or its hash is not the published one."""


class ResultError(GvpError, ValueError):
    """A stored result is missing, or was not written by ``write_result``."""


class DatasetError(GvpError, ValueError):
    """A data set is unfinished, damaged, too small, of another recipe, or cannot be written."""


class CheckpointError(GvpError, ValueError):
    """A file of weights or training state cannot be used: unreadable, or of another kind, format or training."""


class TrainingDivergedError(GvpError, ArithmeticError):
    """The loss grew without bound; checkpoints from before are still there."""
