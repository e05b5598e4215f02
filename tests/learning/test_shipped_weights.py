"""The networks that come with the library: small, as good as they say, and written by version 0.1."""

import numpy as np
import pytest

from gvp_book.experiments.networks import NETWORKS, SETS
from gvp_lib.learning.checkpoints import SHIPPED, load_trained
from gvp_lib.learning.collect import collect_dataset
from gvp_lib.learning.dataset import ViewpointDataset
from gvp_lib.learning.recipe import CollectionRecipe
from gvp_lib.learning.training import evaluate

MADE_AS = {"actions-1x2": "1x2-random-0", "tilt-1x2": "tilt-1x2", "tilt-all": "tilt-all"}


def test_together_they_are_under_10_mb():
    assert sum(file.stat().st_size for file in SHIPPED.glob("*.safetensors")) < 10e6
    assert {file.stem for file in SHIPPED.glob("*.safetensors")} == set(MADE_AS)


@pytest.mark.parametrize("name", MADE_AS)
def test_each_was_made_as_its_experiment_says(name):
    recipe, metadata = NETWORKS[MADE_AS[name]], load_trained(name).metadata
    assert metadata["config"] == {key: recipe.config.to_dict()[key] for key in metadata["config"]}
    assert [each["recipe"] for each in metadata["data"]] == [SETS[name].to_dict() for name in recipe.sets]
    assert metadata["command"].startswith("gvp train ")


@pytest.fixture(scope="module")
def unseen(tmp_path_factory):
    """Views of the 1x2 that no network has seen: another seed, and so another place."""
    folder = tmp_path_factory.mktemp("unseen")
    collect_dataset(folder, CollectionRecipe(n=64, sampling="random", seed=77), progress=False)
    return folder


@pytest.mark.parametrize(("name", "score", "least", "most"), [
    ("actions-1x2", "accuracy", 0.83, 1.0), ("tilt-1x2", "error_deg", 0.0, 1.2),
])  # fmt: skip
def test_in_8_bits_they_know_views_that_they_have_not_seen(unseen, name, score, least, most):
    trained = load_trained(name)
    data = ViewpointDataset(unseen, "all", shift=0, target=trained.metadata["target"], size=trained.metadata["size"])
    scores = evaluate(trained.network, data)
    assert least < scores[score] < most
    assert np.isfinite(scores["loss"])
