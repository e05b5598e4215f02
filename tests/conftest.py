import pytest
from hypothesis import settings

import gvp_lib.simulation  # noqa: F401 - before any test imports mujoco, which then chooses how it draws

# The same examples every time, and no deadline: a busy machine is no failure.
settings.register_profile("gvp", deadline=None, derandomize=True)
settings.load_profile("gvp")


@pytest.hookimpl(tryfirst=True)  # before the plugin that reads the groups
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What stays in one process where several share the tests (``pytest -n 2 --dist loadgroup``): a file's tests, which
    share what one of them made; and all that read the built book, which is built once."""
    for item in items:
        group = "the built book" if "html" in getattr(item, "fixturenames", ()) else item.nodeid.partition("::")[0]
        item.add_marker(pytest.mark.xdist_group(group))
