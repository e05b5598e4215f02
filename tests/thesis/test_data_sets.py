"""What thesis 2.4.2, 2.4.3 and 3.2 say of the two data sets, sentence by sentence.

The action space is in ``tests/planning/test_plan.py``.
"""

import inspect

import numpy as np
import pytest

from gvp_lib.learning.dataset import ViewpointDataset, _split_indices
from gvp_lib.learning.recipe import CollectionRecipe, viewpoints

pytestmark = pytest.mark.check


@pytest.mark.parametrize("sampling", ["uniform", "random"])
def test_two_sets_each_with_4096_images_at_most_30_deg_off_axis(sampling):
    drawn = viewpoints(CollectionRecipe(sampling=sampling, sort=False))
    assert drawn.shape == (4096, 3)
    assert np.degrees(drawn[:, 0].max()) <= 30


def test_each_epoch_covers_2867_images_70_percent_of_the_set():
    assert len(_split_indices(4096, "train", 0.7, [0])) == 2867


def test_the_image_is_cropped_to_128_scaled_to_64_and_shifted_by_at_most_8_px():
    assert CollectionRecipe().crop == 128
    defaults = inspect.unwrap(ViewpointDataset.__init__).__kwdefaults__
    assert (defaults["size"], defaults["share"], defaults["shift"]) == (64, 0.7, None)  # None: 8 for training
