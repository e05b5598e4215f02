"""The errors that misuse raises: one root, :class:`GvpError`; each text says what was given and what would work.

What merely goes wrong in an episode (a lost target, a joint limit) is data, never an exception: see
:class:`gvp_lib.Outcome`.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


class GvpError(Exception):
    """Root of every error that ``gvp_lib`` raises on purpose."""


class InvalidParameterError(GvpError, ValueError):
    """A value is out of its range or of the wrong form."""


class InvalidImageError(GvpError, ValueError):
    """An array is not the image or mask that was expected."""


class UnknownNameError(GvpError, LookupError):
    """A name is not in a registry. The text lists the names that are.

    Parameters
    ----------
    kind
        What the name stands for, in the singular: ``"arm"``, ``"object"``.
    name
        The name as given.
    known
        The names that would have worked.
    """

    def __init__(self, kind: str, name: object, known: Iterable[str]) -> None:
        known = sorted(known)
        close = get_close_matches(str(name), known, n=1)
        hint = f" Did you mean {close[0]!r}?" if close else ""
        super().__init__(f"there is no {kind} named {name!r}.{hint} Known: {', '.join(known)}")
        self.kind, self.name, self.known = kind, name, tuple(known)

    def __reduce__(self) -> tuple[object, ...]:
        # The default would call the class with the finished text alone; errors cross process borders.
        return type(self), (self.kind, self.name, self.known)


class ModelError(GvpError, ValueError):
    """An MJCF model lacks what its ``ArmSpec`` or ``ObjectSpec`` names, or does not compile."""


class UnreachableError(GvpError, ValueError):
    """A pose that was asked for outright has no joint angles within the limits, or none free of collision."""


class MissingExtraError(GvpError, ImportError):
    """A name needs packages that only an extra of this package brings."""

    def __init__(self, name: str, package: str, extra: str) -> None:
        super().__init__(
            f"{name} needs {package}, which is not installed; the extra {extra!r} brings it: "
            f"install gvp_lib[{extra}] in place of gvp_lib"
        )


class CalibrationError(GvpError, ValueError):
    """The pictures given do not determine a camera."""


class JournalError(GvpError, ValueError):
    """A journal of jobs cannot be continued: it is of another recipe, in use, or no journal."""


class WorkerDiedError(GvpError, RuntimeError):
    """A worker of a pool, or a cluster, ended without an answer. What was finished is in the journal."""


class ClusterError(GvpError, ConnectionError):
    """A cluster cannot be reached, or its workers cannot do the jobs."""


class DownloadError(GvpError, ConnectionError):
    """A file that others publish cannot be fetched or kept, or what came is not what they published."""


class ResultError(GvpError, ValueError):
    """A stored result is not there, or is not one that ``write_result`` wrote."""


class DatasetError(GvpError, ValueError):
    """A set of viewpoints is unfinished, damaged, of another recipe, or cannot be written."""


class CheckpointError(GvpError, ValueError):
    """A file of weights or of a training is not what it should be."""


class TrainingDivergedError(GvpError, ArithmeticError):
    """A loss grew without bound; what was kept before is still there."""
