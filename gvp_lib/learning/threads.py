"""How many processors torch computes on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from numbers import Integral

import torch

from gvp_lib.errors import InvalidParameterError

__all__ = ["check_threads", "on_threads"]


def check_threads(count: int | None) -> None:
    """Whether torch can compute on so many threads.

    Raises
    ------
    InvalidParameterError
        It cannot.
    """
    if count is not None and (isinstance(count, bool) or not isinstance(count, Integral) or count < 1):
        raise InvalidParameterError(
            f"threads is a whole number, 1 or more, or None for as many as torch is set to; got {count!r}"
        )


@contextmanager
def on_threads(count: int | None) -> Iterator[None]:
    """A context in which torch computes on so many threads; None: on as many as before.

    The number decides the order in which sums are taken, and so the last bits of a result; and processes that work
    beside each other are faster on one each.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(before if count is None else count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
