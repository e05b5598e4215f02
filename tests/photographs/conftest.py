"""Photographs of a desk, rendered once: what a telephone would take, and the truth."""

from dataclasses import replace

import cv2
import pytest

from gvp_book.experiments.photographs import photographed


@pytest.fixture(scope="session")
def nine():
    """The last is of a package that was moved."""
    return photographed("tea", seed=1, count=9, size=(1440, 1080), moved=8)


@pytest.fixture(scope="session")
def desk(nine):
    return replace(nine, pictures=nine.pictures[:8], cameras=nine.cameras[:8], masks=nine.masks[:8])


@pytest.fixture(scope="session")
def files(desk, tmp_path_factory):
    """The same as files."""
    folder = tmp_path_factory.mktemp("photographs")
    for k, picture in enumerate(desk.pictures):
        cv2.imwrite(str(folder / f"{k}.jpg"), cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 92])
    return folder
