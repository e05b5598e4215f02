"""Sets of viewpoints that several tests read, and a network small enough to train; none may write into the sets."""

import pytest
import torch
from tiny_training import TINY
from viewpoint_sets import UR5E, collect, small

from gvp_lib.learning.resnet import ARCHITECTURES


@pytest.fixture(scope="session")
def plain(tmp_path_factory):
    """The set of `small()`, collected in this process at one go."""
    return collect(tmp_path_factory.mktemp("sets") / "plain", small()).folder


@pytest.fixture(scope="session")
def ur5e(tmp_path_factory):
    """The thesis's set, but of 64."""
    return collect(tmp_path_factory.mktemp("sets") / "ur5e", UR5E).folder


@pytest.fixture(scope="session")
def lessons(tmp_path_factory):
    """Enough to train the tiny network on: 64 samples with all five actions of 20 deg."""
    return collect(tmp_path_factory.mktemp("sets") / "lessons", small(n=64, shard=16)).folder


@pytest.fixture(scope="module")
def tiny():
    """A network that trains in no time, and one thread, on which the bits do not depend on the machine's cores."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(ARCHITECTURES, "tiny", TINY)
        yield
    torch.set_num_threads(threads)
