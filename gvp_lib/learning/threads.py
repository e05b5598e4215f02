"""How many processors torch computes on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch

__all__ = ["on_threads"]


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
