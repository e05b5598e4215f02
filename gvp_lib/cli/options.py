"""Options that several commands have."""

from __future__ import annotations

import argparse

__all__ = ["add_where"]


def add_where(command: argparse.ArgumentParser, do_it: str) -> None:
    """On this machine's processes, or on a cluster."""
    where = command.add_mutually_exclusive_group()
    where.add_argument("--workers", type=int, metavar="N", help="processes here (default: 1)")
    where.add_argument("--dask", metavar="ADDRESS", help=f"of a Dask scheduler, whose workers {do_it} instead")
