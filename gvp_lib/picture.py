"""Objects that show themselves: ``plot()``, a picture as a notebook's output, one line of text, and words for how many.

This is the one module that looks up to ``gvp_lib.views``, and only when a picture is asked for.
"""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any, ClassVar

from gvp_lib.errors import MissingExtraError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Pictured"]


class Pictured:
    """Mixin for classes with a figure: ``_figure`` names the function of ``gvp_lib.views.figures`` that draws it.

    Examples
    --------
    >>> from gvp_lib import VirtualSphere
    >>> len(VirtualSphere((0.5, 0.0, 0.0), 0.25).plot(max_tilt=0.7).axes)
    1
    """

    __slots__ = ()
    _figure: ClassVar[str]

    def plot(self, **options: Any) -> Figure:
        """Draw the object as a figure, which a notebook also shows for it.

        Parameters
        ----------
        **options
            Options of the function in ``gvp_lib.views.figures`` that draws it.

        Raises
        ------
        MissingExtraError
            matplotlib, or another package of the extra ``notebooks``, is not installed.
        """
        try:
            from gvp_lib.views import figures

            figure: Figure = getattr(figures, self._figure)(self, **options)
        except ModuleNotFoundError as error:
            if (error.name or "").startswith("gvp_lib"):
                raise
            raise MissingExtraError(f"{type(self).__name__}.plot()", error.name or "a package", "notebooks") from error
        return figure

    def _repr_png_(self) -> bytes | None:
        try:
            png: bytes = self.plot()._repr_png_()  # type: ignore[attr-defined]
        except Exception:  # a notebook falls back to the repr; plot() is where the error is told
            return None
        return png


def count(n: int, name: str) -> str:
    """Number and noun: '1 picture', '0 bodies', '2 overlays'."""
    plural = f"{name[:-1]}ies" if name.endswith(("dy", "ry")) else f"{name}s"
    return f"{n} {name if n == 1 else plural}"


def brief(owner: object) -> str:
    """One line for an object of settings: those that are not the default, and its parts by their class."""

    def text(value: object) -> str:
        if isinstance(value, float):
            return f"{value:.4g}"
        if isinstance(value, tuple):
            return f"({', '.join(map(text, value))})"
        return repr(value) if isinstance(value, str | int | None) else getattr(value, "__name__", type(value).__name__)

    changed = [
        f"{field.name}={text(value)}"
        for field in fields(owner)  # type: ignore[arg-type]
        if field.repr and (value := getattr(owner, field.name)) is not field.default and value != field.default
    ]
    return f"{type(owner).__name__}({', '.join(changed)})"
