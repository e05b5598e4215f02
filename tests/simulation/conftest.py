"""Cells for the tests of this room, built once in a session and reset with a seed before each use.

A test takes the fixture ``cell_of`` and asks for what it needs: ``cell_of("ur5e", "cylinder", "tilted", seed=5)``. Arm,
object, placement and seed default to the Baxter, ``cuboid_1x2``, flat and 3; ``dynamic=True`` switches the servos on;
all other options are those of ``WorkCell``. The cell stands at the beginning of that seed's episode, whatever the test
before did in it: a test may move the arm and the object as it likes. It does not close the cell, and leaves its model
as it was. A test that must see how a cell is made or closed makes its own.
"""

import pytest
from cells import Cells

from gvp_lib.simulation.arms import ArmSpec, arm_spec
from gvp_lib.simulation.kinematics import InverseKinematics


@pytest.fixture(scope="session")
def every_cell():
    """All cells of the session; ``cell_of`` is the one to use."""
    return Cells()


@pytest.fixture(scope="module")
def cell_of(every_cell):
    """A cell at the beginning of an episode, by what it is made of: ``cell_of("ur5e", seed=5, dynamic=True)``."""
    yield every_cell
    every_cell.close()


@pytest.fixture(scope="session")
def kinematics_of():
    """The inverse kinematics of an arm, by its name or spec, made once: ``kinematics_of("baxter")``."""
    made: dict[str, InverseKinematics] = {}

    def get(arm: str | ArmSpec) -> InverseKinematics:
        spec = arm_spec(arm)
        if spec.name not in made:
            made[spec.name] = InverseKinematics(spec)
        return made[spec.name]

    return get
