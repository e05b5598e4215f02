"""Small sets of viewpoints that tests share, and ways to compare them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
from numpy.typing import NDArray

from gvp_lib.learning.collect import Collection, collect_dataset
from gvp_lib.learning.recipe import CollectionRecipe
from gvp_lib.learning.shards import decoded, read_columns

UR5E = CollectionRecipe(n=64, shard=32, seed=4)
"""The thesis's uniform set, but of 64."""


def small(**options: Any) -> CollectionRecipe:
    """16 samples in four shards, held by nobody, unless told otherwise."""
    return CollectionRecipe(**{"arm": "floating", "n": 16, "rolls": 4, "shard": 4, "seed": 1, **options})


def collect(folder: Path, recipe: CollectionRecipe, **options: Any) -> Collection:
    return collect_dataset(folder, recipe, progress=False, **options)


def contents(folder: Path) -> dict[str, bytes]:
    """Every file of a folder, hidden ones too."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def table(folder: Path, columns: Sequence[str] | None = None) -> pa.Table:
    return read_columns(folder, columns)


def pictures(folder: Path) -> list[NDArray[Any]]:
    return [decoded(cell) for cell in table(folder, ["image"])["image"].to_pylist()]
