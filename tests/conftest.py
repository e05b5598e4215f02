from functools import cache

import pytest
from hypothesis import settings

import gvp_lib.simulation  # noqa: F401 - before any test imports mujoco, which then chooses how it draws

# The same examples every time, and no deadline: a busy machine is no failure.
settings.register_profile("gvp", deadline=None, derandomize=True)
settings.load_profile("gvp")


@pytest.fixture(scope="session")
def plan_of():
    """Full plan of the image-moment planner over a block, by its estimator: each is made once."""
    from eye_in_hand import white
    from synthetic import over_block

    from gvp_lib.planning.image_moments import ImageMomentPlanner

    return cache(lambda estimator: ImageMomentPlanner(white, estimator).plan(over_block()))
