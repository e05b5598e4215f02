"""Small sets of viewpoints that tests share, and ways to compare them."""

from gvp_lib.learning.collect import collect_dataset
from gvp_lib.learning.recipe import CollectionRecipe
from gvp_lib.learning.shards import decoded, read_columns

UR5E = CollectionRecipe(n=64, shard=32, seed=4)
"""The thesis's uniform set, but of 64."""


def small(**options):
    """16 samples in four shards, held by nobody, unless told otherwise."""
    return CollectionRecipe(**{"arm": "floating", "n": 16, "rolls": 4, "shard": 4, "seed": 1, **options})


def collect(folder, recipe, **options):
    return collect_dataset(folder, recipe, progress=False, **options)


def contents(folder):
    """Every file of a folder, hidden ones too."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def pictures(folder):
    return [decoded(cell) for cell in read_columns(folder, ["image"])["image"].to_pylist()]
