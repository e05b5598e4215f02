"""Packages whose names load when first used, so that importing one costs nothing.

The names stand in the package's ``__init__.pyi``, one a line, where type checkers and editors find them, too. A name
that needs what is not installed says which extra brings it. Whatever goes wrong where a name is loaded is told as what
it is; only an ``AttributeError``, which ``from ... import`` would hide, becomes the cause of an ``ImportError``.
"""

from __future__ import annotations

import sys
import warnings
from importlib import import_module

TYPE_CHECKING = False  # typing and collections.abc would double the time of `import gvp_lib`
if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


def attach(
    package: str, extra: str | None = None, moved: Mapping[str, str] | None = None
) -> tuple[Callable[[str], object], Callable[[], list[str]], list[str]]:
    """``__getattr__``, ``__dir__`` and ``__all__`` of a package whose stub lists its names.

    Parameters
    ----------
    package
        Name of the package. Its stub has lines such as ``from gvp_lib.motion import Arc as Arc``. One that ends with
        ``# needs torch`` is in ``__dir__`` and ``__all__`` only where torch is installed.
    extra
        Extra, in pyproject.toml, that brings what the names need; by default, they need none.
    moved
        Names that the package once had, and in full what each is now. They still work, with a warning.

    Examples
    --------
    >>> __getattr__, __dir__, __all__ = attach("gvp_lib.learning", extra="learning")
    >>> "TrainConfig" in __all__
    True
    """
    module, moved = sys.modules[package], moved or {}
    # Read by its loader, from a folder or a zip.
    stub: bytes = module.__spec__.loader.get_data(f"{module.__path__[0]}/__init__.pyi")  # type: ignore[union-attr]
    lines = [line.split() for line in stub.decode().splitlines() if line.startswith("from ")]
    homes = {words[5]: words[1] for words in lines}  # from HOME import NAME as NAME # needs PACKAGE
    # As importlib.util.find_spec would, whose import takes longer than all the rest.
    missing = {need for words in lines for need in words[8:] if not any(f.find_spec(need, None) for f in sys.meta_path)}
    here = [words[5] for words in lines if not missing & {*words[8:]}]

    def load(home: str, name: str) -> object:
        """Import a name from its home, or say which extra it takes."""
        try:
            return import_module(f"{home}.{name}") if home == package else getattr(import_module(home), name)
        except ModuleNotFoundError as error:
            if extra is None or (error.name or "").startswith(("gvp_lib", "gvp_book")):
                raise
            from gvp_lib.errors import MissingExtraError

            raise MissingExtraError(name, error.name or "a package", extra) from error
        except AttributeError as error:  # `from ... import` would hide it behind "cannot import name"
            raise ImportError(f"{home}, which holds {name}, does not load: {type(error).__name__}: {error}") from error

    def __getattr__(name: str) -> object:
        if name in moved:
            new = moved[name]
            text = f"{package}.{name} is {new} from 0.2 on; the old name goes in 0.3"
            warnings.warn(text, DeprecationWarning, stacklevel=2)
            home, _, new_name = new.rpartition(".")
            return load(home, new_name)
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = load(homes[name], name)
        setattr(module, name, value)
        return value

    return __getattr__, lambda: sorted({*vars(module), *here}), here
