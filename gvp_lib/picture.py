"""Objects that show themselves: ``plot()``, and a picture as a notebook's output.

The one place that looks up to :mod:`gvp_lib.views`, and only when a picture is asked for: importing it loads nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from gvp_lib.errors import GvpError, MissingExtraError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Pictured"]


class Pictured:
    """Mixin of what has a figure: ``_figure`` names the function of :mod:`gvp_lib.views.figures` that draws it."""

    __slots__ = ()
    _figure: ClassVar[str]

    def plot(self, **options: Any) -> Figure:
        """Draw it.

        Parameters
        ----------
        **options
            Options of the function in :mod:`gvp_lib.views.figures` that draws it.

        Raises
        ------
        MissingExtraError
            There is no matplotlib, or another package of the extra ``notebooks``.
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
        except GvpError:  # no matplotlib, or nothing to render with: a notebook falls back to the repr
            return None
        return png
