"""Cells for the tests of this room, built once in a session and reset with a seed before each use.

``cell_of("ur5e", "cylinder", "tilted", seed=5)`` stands at the beginning of that episode, whatever the test before did
in it; ``dynamic=True`` switches the servos on, and all other options are those of ``WorkCell``. A test does not close
the cell, and leaves its model as it was. A test that must see how a cell is made or closed makes its own.
"""

from functools import cache

import pytest
from cells import Cells

from gvp_lib.simulation.kinematics import InverseKinematics


@pytest.fixture(scope="session")
def every_cell():
    """All cells of the session; ``cell_of`` is the one to use."""
    return Cells()


@pytest.fixture(scope="module")
def cell_of(every_cell):
    yield every_cell
    every_cell.close()


@pytest.fixture(scope="session")
def kinematics_of():
    """The inverse kinematics of an arm by its spec, made once: ``kinematics_of(ARMS["baxter"])``."""
    return cache(InverseKinematics)
