"""Grasp viewpoint planning with one RGB camera in the hand (Smith, UC San Diego, 2020), in MuJoCo.

The public names stand in ``__init__.pyi``. Each is loaded when first used, so that ``import gvp_lib`` loads neither
torch nor mujoco.
"""

from __future__ import annotations

from importlib import import_module

__version__ = "0.1.0"

# Lines such as `from gvp_lib.room.module import Name as Name`, from a folder or a zip.
_STUB: bytes = __spec__.loader.get_data(__file__.rpartition("__init__")[0] + "__init__.pyi")  # type: ignore[union-attr]
_LINES = (line.split() for line in _STUB.decode().splitlines() if line.startswith("from "))
_HOME = {words[-1]: words[1].removeprefix("gvp_lib.") for words in _LINES}

_EXTRA = {"views": "notebooks", "learning": "learning"}
"""What the light core does without: the extra, in pyproject.toml, that brings what a room needs."""

__all__ = [*_HOME, "__version__"]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    room = _HOME[name].partition(".")[0]
    try:
        value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    except ModuleNotFoundError as error:
        if room not in _EXTRA or (error.name or "").startswith(__name__):
            raise
        from gvp_lib.errors import MissingExtraError

        raise MissingExtraError(name, error.name or "a package", _EXTRA[room]) from error
    except AttributeError as error:  # `from gvp_lib import ...` would hide it behind "cannot import name"
        raise ImportError(f"gvp_lib.{_HOME[name]}, which holds {name}, does not load: {error}") from error
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
