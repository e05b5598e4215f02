"""Errors that misuse raises. All descend from :class:`GvpError`, and each says what was given and what would work.

What goes wrong in an episode (a lost target, a joint limit) is data, never an exception: see
:class:`gvp_lib.motion.Outcome`.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


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
            f"{name} needs {package}, which is not installed; the extra {extra!r} brings it: "
            f"install gvp_lib[{extra}] in place of gvp_lib"
        )


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
