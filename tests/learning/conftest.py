"""Sets of viewpoints that several tests read; none may write into them."""

from pathlib import Path

import pytest
from viewpoint_sets import UR5E, collect, small


@pytest.fixture(scope="session")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The set of `small()`, collected in this process at one go."""
    return collect(tmp_path_factory.mktemp("sets") / "plain", small()).folder


@pytest.fixture(scope="session")
def ur5e(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The thesis's set, but of 64."""
    return collect(tmp_path_factory.mktemp("sets") / "ur5e", UR5E).folder
