"""One work cell at a time, for jobs of one case that follow each other."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Generic, Protocol, TypeVar

__all__ = ["Kept"]


class _Closable(Protocol):
    def close(self) -> None: ...


T = TypeVar("T", bound=_Closable)


class Kept(Generic[T]):
    """The last thing that was made, under its key; it is closed when another takes its place.

    A cell's graphics context takes some 100 MB. Left to the garbage collector it would stay for long, and an experiment
    that goes from case to case would fill the memory.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> kept = Kept[WorkCell]()
    >>> cell = kept.get("flat", lambda: WorkCell("floating"))
    >>> kept.get("flat", lambda: WorkCell("floating")) is cell
    True
    """

    def __init__(self) -> None:
        self._last: tuple[Hashable, T] | None = None

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        """What was made last, if it was under this key; else another."""
        if self._last is None or self._last[0] != key:
            if self._last is not None:
                self._last[1].close()
                self._last = None  # should making the next one fail
            self._last = key, make()
        return self._last[1]
