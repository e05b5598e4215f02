from hypothesis import settings

import gvp_lib.simulation  # noqa: F401 - before any test imports mujoco, which then chooses how it draws

# The same examples every time, and no deadline: a busy machine is no failure.
settings.register_profile("gvp", deadline=None, derandomize=True)
settings.load_profile("gvp")
