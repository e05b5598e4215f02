"""A set as torch reads it: split, shrunk, shifted anew at each epoch."""

import cv2
import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader
from viewpoint_sets import UR5E, pictures, table

from gvp_lib.errors import DatasetError, InvalidParameterError, UnknownNameError
from gvp_lib.learning.dataset import ViewpointDataset


def keys(data):
    return [image.tobytes() for image in data.images]


def shifted(image, u, v):
    """By padding with the border and cutting out, u to the right and v down."""
    padded = np.pad(image, ((8, 8), (8, 8), (0, 0)), mode="edge")
    return padded[8 - v : 72 - v, 8 - u : 72 - u]


def test_the_split_is_70_to_30_disjoint_and_complete(ur5e):
    train, rest, every = (keys(ViewpointDataset(ur5e, split)) for split in ("train", "validation", "all"))
    assert (len(train), len(rest)) == (45, 19)
    assert len(set(every)) == UR5E.n
    assert sorted(train + rest) == sorted(every)


def test_the_split_is_its_seed_s(ur5e):
    first, again, other = (keys(ViewpointDataset(ur5e, seed=seed)) for seed in (0, 0, 1))
    assert first == again
    assert first != other


def test_pictures_are_shrunk_by_area_and_scaled_to_one(ur5e):
    data = ViewpointDataset(ur5e, "all")
    image, action = data[3]
    assert (image.dtype, tuple(image.shape), action.dtype) == (torch.float32, (3, 64, 64), torch.int64)
    expected = cv2.resize(pictures(ur5e)[3], (64, 64), interpolation=cv2.INTER_AREA)
    np.testing.assert_array_equal(data.images[3], expected)
    np.testing.assert_allclose(image.numpy().transpose(1, 2, 0), expected / 255, atol=1e-6)
    assert data.actions.tolist() == table(ur5e)["action"].to_pylist()


def test_a_shift_repeats_the_border_up_to_8_px_and_is_drawn_anew_at_each_epoch(ur5e):
    data = ViewpointDataset(ur5e)
    found = set()
    for data.epoch in range(3):
        for k in range(len(data)):
            got = (data[k][0].numpy().transpose(1, 2, 0) * 255).round().astype(np.uint8)
            u, v = data._drawn().shifts[k]
            found.add((int(u), int(v)))
            np.testing.assert_array_equal(got, shifted(data.images[k], u, v))
    assert (np.min(list(found)), np.max(list(found))) == (-8, 8)
    assert len(found) > 80


def test_what_is_seen_depends_on_seed_epoch_and_index_alone(ur5e):
    one, two = ViewpointDataset(ur5e), ViewpointDataset(ur5e)
    one.epoch = two.epoch = 5
    _ = one[0], one[7]
    assert torch.equal(one[3][0], two[3][0])
    before = one.batch(range(len(one)))[0]
    one.epoch = 6
    assert not torch.equal(one.batch(range(len(one)))[0], before)
    one.epoch = 5
    assert torch.equal(one.batch(range(len(one)))[0], before)


def test_validation_is_not_shifted(ur5e):
    data = ViewpointDataset(ur5e, "validation")
    before = data[0][0]
    data.epoch = 1
    assert torch.equal(data[0][0], before)


@pytest.mark.parametrize("workers", [0, pytest.param(2, marks=pytest.mark.full)])
def test_a_loader_gives_what_the_set_gives(workers, ur5e):
    data, start = ViewpointDataset(ur5e), "spawn" if workers else None
    loaded = list(DataLoader(data, batch_size=16, num_workers=workers, multiprocessing_context=start))
    images, actions = data.batch(range(len(data)))
    assert torch.equal(torch.cat([batch[0] for batch in loaded]), images)
    assert torch.equal(torch.cat([batch[1] for batch in loaded]), actions)


def test_several_sets_are_put_together_and_a_tilt_is_a_target(ur5e, plain):
    both = ViewpointDataset([ur5e, plain], "all", target="tilt")
    rows = table(plain).to_pandas()
    assert len(both) == 80
    expected = np.stack([rows["angle"] * np.cos(rows["direction"]), rows["angle"] * np.sin(rows["direction"])], axis=1)
    np.testing.assert_allclose(both.tilts[64:], expected, atol=1e-6)
    assert (both[70][1].dtype, tuple(both[70][1].shape)) == (torch.float32, (2,))


def test_damage_and_misuse_are_refused(ur5e, tmp_path):
    with pytest.raises(DatasetError, match="not finished"):
        ViewpointDataset(tmp_path)
    with pytest.raises(UnknownNameError, match="no split named 'test'"):
        ViewpointDataset(ur5e, "test")
    for bad in ({"share": 0}, {"size": 4}, {"shift": 64}, {"crop": 129}):
        with pytest.raises(InvalidParameterError, match=r"got|larger than the picture"):
            ViewpointDataset(ur5e, **bad)
