"""A set opens in the tools that people use, as it is; no network is needed."""

import numpy as np
import pytest
from viewpoint_sets import pictures

from gvp_lib.errors import DatasetError, UnknownNameError
from gvp_lib.learning.shards import COLUMNS, decoded, read_columns


def test_hugging_face_opens_it_with_pictures_decoded_and_actions_named(ur5e, tmp_path, monkeypatch):
    monkeypatch.setenv("HF_DATASETS_OFFLINE", "1")
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    from datasets import load_dataset

    data = load_dataset(str(ur5e), cache_dir=str(tmp_path))["train"]
    assert data.features["action"].names == ["UP", "LEFT", "DOWN", "RIGHT", "NO_OP"]
    assert list(data.features) == list(COLUMNS)
    for row, picture in zip(data, pictures(ur5e), strict=True):
        np.testing.assert_array_equal(np.asarray(row["image"]), picture)


def test_pandas_opens_it(ur5e):
    import pandas as pd

    rows = pd.read_parquet(ur5e / "data")
    assert list(rows.columns) == list(COLUMNS)
    assert (rows["action"].dtype, rows["angle"].dtype, rows["overflow"].dtype) == (np.int64, np.float32, bool)
    assert {len(pose) for pose in rows["world_from_camera"]} == {7}


def test_samples_on_the_arm_take_at_most_three_frames_are_aligned_and_replaced_where_out_of_reach(ur5e):
    rows = read_columns(ur5e).to_pandas()
    assert rows["frames"].max() <= 3
    assert (rows["attempts"] > 1).any()
    assert rows["angle"].to_numpy() == pytest.approx(rows["tilt"].to_numpy(), abs=np.radians(3))
    assert np.linalg.norm(np.stack(rows["blob_centroid"]) - (319.5, 239.5), axis=1).max() < 3


def test_columns_are_named_in_any_sequence_and_one_that_is_none_is_refused(ur5e):
    assert read_columns(ur5e, ("angle", "action")).column_names == ["angle", "action"]
    with pytest.raises(UnknownNameError, match=r"no column named 'angles'.*Did you mean 'angle'"):
        read_columns(ur5e, ["angles"])


def test_what_is_no_picture_is_refused():
    with pytest.raises(DatasetError, match="4 bytes are no PNG picture; give a cell of the column 'image'"):
        decoded(b"none")
