"""A set as torch reads it: split, resized, shifted anew at each epoch."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from numpy.lib.stride_tricks import sliding_window_view
from torch.utils.data import DataLoader
from viewpoint_sets import UR5E, pictures

from gvp_lib.errors import GvpError, InvalidParameterError
from gvp_lib.learning.dataset import ViewpointDataset
from gvp_lib.learning.labels import TURNED_ACTIONS, TURNS, turned
from gvp_lib.learning.recipe import CollectionRecipe
from gvp_lib.learning.shards import read_columns
from gvp_lib.simulation.sensors import Noise


def keys(data):
    return [image.tobytes() for image in data.images]


def seen(data):
    """Every picture as the network sees it, uint8 (n, size, size, 3), and its target."""
    images, targets = data.batch(range(len(data)))
    return (images.numpy() * 255).round().astype(np.uint8).transpose(0, 2, 3, 1), targets.numpy()


@pytest.fixture(scope="module")
def train(ur5e):
    return ViewpointDataset(ur5e)


def test_the_split_is_70_to_30_disjoint_complete_and_its_seed_s(ur5e, train):
    rest, every = (keys(ViewpointDataset(ur5e, split)) for split in ("validation", "all"))
    assert (len(train), len(rest)) == (45, 19)
    assert len(set(every)) == UR5E.n
    assert sorted(keys(train) + rest) == sorted(every)
    assert keys(ViewpointDataset(ur5e, seed=0)) == keys(train)
    assert keys(ViewpointDataset(ur5e, seed=1)) != keys(train)
    with pytest.raises(IndexError, match="45 of 45 samples"):
        train[45]


def test_pictures_are_resized_by_area_and_scaled_to_one(ur5e):
    data = ViewpointDataset(ur5e, "all")
    image, action = data[3]
    assert (image.dtype, action.dtype) == (torch.float32, torch.int64)
    expected = cv2.resize(pictures(ur5e)[3], (64, 64), interpolation=cv2.INTER_AREA)
    np.testing.assert_array_equal(data.images[3], expected)
    np.testing.assert_allclose(image.numpy().transpose(1, 2, 0), expected / 255, atol=1e-6)
    assert data.actions.tolist() == read_columns(ur5e)["action"].to_pylist()


def test_a_shift_repeats_the_border_up_to_8_px_and_is_drawn_anew_at_each_epoch(train):
    """Each picture is one of the 17 x 17 cut out of the padded one."""
    found = []
    for train.epoch in range(3):
        for image, shifted in zip(train.images, seen(train)[0], strict=True):
            padded = np.pad(image, ((8, 8), (8, 8), (0, 0)), mode="edge")
            cuts = sliding_window_view(padded, (64, 64, 3))[..., 0, :, :, :]  # (17, 17, 64, 64, 3)
            found.append(np.argwhere((cuts == shifted).all(axis=(2, 3, 4)))[0])
    assert (np.min(found), np.max(found)) == (0, 16)
    assert len(set(map(tuple, found))) > 80


@pytest.mark.parametrize("target", ["action", "tilt"])
def test_pictures_are_turned_and_mirrored_in_all_eight_ways_and_their_targets_with_them(target, ur5e):
    data, found = ViewpointDataset(ur5e, shift=0, dihedral=True, target=target), []
    plain = data.actions if target == "action" else data.tilts
    for image, own, picture, label in zip(data.images, plain, *seen(data), strict=True):
        (number,) = [k for k, turn in enumerate(TURNS) if (turned(image, turn) == picture).all()]
        np.testing.assert_allclose(label, TURNED_ACTIONS[number][own] if target == "action" else TURNS[number] @ own)
        found.append(number)
    assert set(found) == set(range(8))


def test_mixed_channels_are_means_of_the_three_so_that_gray_stays_gray(ur5e):
    data = ViewpointDataset(ur5e, shift=0, colors=True)
    pictures = seen(data)[0].astype(int)
    low, high = (bound(data.images.astype(int), axis=3, keepdims=True) for bound in (np.min, np.max))
    assert ((low - 1 <= pictures) & (pictures <= high + 1)).all()
    assert (pictures != data.images).any(axis=(1, 2, 3)).all()


def test_what_is_seen_depends_on_seed_epoch_and_index_alone(ur5e, train):
    other = ViewpointDataset(ur5e)
    other.epoch = train.epoch = 5
    before = train.batch(range(len(train)))[0]
    assert torch.equal(other[3][0], before[3])
    train.epoch = 6
    assert not torch.equal(train.batch(range(len(train)))[0], before)
    train.epoch = 5
    assert torch.equal(train.batch(range(len(train)))[0], before)


@pytest.mark.full
def test_a_loader_s_processes_give_what_the_set_gives(train):
    loaded = list(DataLoader(train, batch_size=16, num_workers=2, multiprocessing_context="spawn"))
    images, actions = train.batch(range(len(train)))
    assert torch.equal(torch.cat([batch[0] for batch in loaded]), images)
    assert torch.equal(torch.cat([batch[1] for batch in loaded]), actions)


def test_several_sets_are_put_together_and_a_tilt_is_a_target(ur5e, plain):
    both = ViewpointDataset([ur5e, plain], "all", target="tilt")
    rows = read_columns(plain).to_pandas()
    assert repr(both) == ("ViewpointDataset(all: 80 samples, cuboid_1x2, ur5e + floating, crop 128 px, ur5e + plain)")
    expected = np.stack([rows["angle"] * np.cos(rows["direction"]), rows["angle"] * np.sin(rows["direction"])], axis=1)
    np.testing.assert_allclose(both.tilts[64:], expected, atol=1e-6)
    assert (both[70][1].dtype, tuple(both[70][1].shape)) == (torch.float32, (2,))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"split": "test"}, "no split named 'test'"),
        ({"target": "roll"}, "no target named 'roll'"),
        ({"share": 0}, "got 0, 64, 8"),
        ({"shift": 64}, "got 0.7, 64, 64"),
        ({"crop": 129}, "larger than the picture"),
        ({"folder": []}, "one folder or more; got none"),
        ({"folder": 7}, "a folder, given by its path; got a int: 7"),
        ({"folder": "nowhere"}, "not finished, or there is none"),
    ],
)
def test_misuse_is_refused(options, message, ur5e):
    with pytest.raises(GvpError, match=message):
        ViewpointDataset(**{"folder": ur5e, **options})


@pytest.mark.parametrize("given", [3, [45], [-46], [0.5], [[1]], [True]])
def test_a_batch_of_what_is_no_sample_is_refused(given, train):
    with pytest.raises(InvalidParameterError, match=r"whole numbers from -45 to 44, shape \(k,\); got"):
        train.batch(given)


@pytest.mark.parametrize("index", [slice(3), 1.5, "3", None])
def test_what_is_no_number_of_one_sample_is_refused(index, train):
    with pytest.raises(InvalidParameterError, match="one sample has a whole number, several are a batch"):
        train[index]


@pytest.mark.parametrize("kind", [np.int64, torch.tensor, lambda k: np.array(k, np.uint8)])
def test_a_sample_is_found_by_any_kind_of_whole_number(kind, train):
    assert torch.equal(train[kind(3)][0], train[3][0])
    assert torch.equal(train.batch([kind(3), kind(2)])[0], train.batch([3, 2])[0])


def test_a_set_that_version_0_1_wrote_opens():
    folder = Path(__file__).parent / "set-0.1"
    card = json.loads((folder / "card.json").read_text())
    recipe = CollectionRecipe(arm="floating", n=4, rolls=2, shard=4, seed=1, crop=32, noise=Noise.thesis())
    assert (card["versions"]["gvp_lib"], card["recipe"]) == ("0.1.0", recipe.to_dict())
    data = ViewpointDataset(folder, "all", size=32, target="tilt")
    assert data.actions.tolist() == [1, 3, 3, 1]
    np.testing.assert_array_equal(data.images, pictures(folder))
    np.testing.assert_allclose(np.linalg.norm(data.tilts, axis=1), read_columns(folder, ["angle"])["angle"], rtol=1e-6)
