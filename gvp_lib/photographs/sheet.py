"""A sheet of paper that tells a camera where it stands: markers around a free middle, to print and lay an object on."""

from __future__ import annotations

import os
import zlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError

__all__ = ["Sheet"]

_PAPERS = {"a4": (0.210, 0.297), "letter": (0.2159, 0.2794)}  # m
_SQUARE, _MARKER = 0.015, 0.011  # m
_MARGIN = 0.011  # m, at least, where no printer prints
_RING = 2  # squares of markers about the middle
_FINE = 6  # of the middle's small squares to a square: whatever color an object has, it hides black ones or white ones
_FIRST = {"a4": 0, "letter": 120}  # number of the first marker: no marker is on both papers
_DICTIONARY = cv2.aruco.DICT_4X4_250
_GAP = 2  # small squares between them and the ring, for they would draw the corners in it toward themselves
_BAR = 0.100  # m
_DPI = 600


@checked
@dataclass(frozen=True)
class Sheet:
    """Sheet of squares and markers (OpenCV's ChArUco) around a middle on which an object stands.

    Whatever picture shows enough of it tells where the camera stood against the sheet, whose frame has its origin in
    the middle of the paper, x to the right, y toward the top, z up from it.

    Parameters
    ----------
    paper
        ``"a4"`` or ``"letter"``.
    bar
        Length of the printed scale bar as a ruler measures it, m: many a printer makes all a little smaller.

    Examples
    --------
    >>> sheet = Sheet("a4")
    >>> sheet
    Sheet('a4', a middle of 120 x 210 mm)
    >>> sheet.image(dpi=150).shape
    (1754, 1240)
    """

    paper: Literal["a4", "letter"] = "a4"
    bar: float = _BAR

    def __post_init__(self) -> None:
        if self.paper not in _PAPERS:
            raise InvalidParameterError(
                f"a sheet's paper is one of {', '.join(map(repr, _PAPERS))}; got {self.paper!r}"
            )
        if not 0.8 * _BAR < self.bar < 1.2 * _BAR:
            raise InvalidParameterError(
                f"bar is the length of the scale bar as printed, in meters, which is meant to be {_BAR} and is never a "
                f"fifth off; got {self.bar}"
            )

    def __repr__(self) -> str:
        width, height = (1000 * side for side in self.free)
        off = f", printed at {100 * self.scale:.1f} %" if self.scale != 1 else ""
        return f"Sheet({self.paper!r}, a middle of {width:.0f} x {height:.0f} mm{off})"

    @property
    def scale(self) -> float:
        """Share of the meant size at which it is printed."""
        return self.bar / _BAR

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the paper, as if it were printed at the same scale, m."""
        width, height = _PAPERS[self.paper]
        return self.scale * width, self.scale * height

    @property
    def squares(self) -> tuple[int, int]:
        """Number of squares across and down."""
        across, down = (int((side - 2 * _MARGIN) / _SQUARE + 1e-9) for side in _PAPERS[self.paper])
        return across, down

    @property
    def free(self) -> tuple[float, float]:
        """Width and height of the middle, where there is no marker, m."""
        across, down = ((n - 2 * _RING) * self.scale * _SQUARE for n in self.squares)
        return across, down

    @property
    def fine(self) -> float:
        """Side of the small squares in the middle, m."""
        return self.scale * _SQUARE / _FINE

    @cached_property
    def board(self) -> cv2.aruco.CharucoBoard:
        """Board for OpenCV, in meters, of which the middle has no markers."""
        ids = _FIRST[self.paper] + np.arange(self.squares[0] * self.squares[1] // 2)
        dictionary = cv2.aruco.getPredefinedDictionary(_DICTIONARY)
        return cv2.aruco.CharucoBoard(self.squares, self.scale * _SQUARE, self.scale * _MARKER, dictionary, ids)

    @checked
    def image(self, dpi: float = 300) -> NDArray[np.uint8]:
        """Sheet as it is printed, gray, uint8 (H, W): black is 0.

        Parameters
        ----------
        dpi
            Pixels per inch, 60 or more.
        """
        if not 60 <= dpi <= 2400:
            raise InvalidParameterError(f"dpi is the number of pixels per inch, from 60 to 2400; got {dpi}")
        per_m = dpi / 0.0254
        width, height = (round(side * per_m) for side in _PAPERS[self.paper])
        page = np.full((height, width), 255, np.uint8)
        across, down = self.squares
        ring = (round(across * _SQUARE * per_m), round(down * _SQUARE * per_m))
        printed = np.asarray(self.board.generateImage(ring, marginSize=0), np.uint8)
        u, v = (width - ring[0]) // 2, (height - ring[1]) // 2
        page[v : v + ring[1], u : u + ring[0]] = printed
        inner = [_RING * _SQUARE * per_m + at for at in (u, v)]
        rows, columns = np.indices(page.shape)
        fine = [np.floor((at - start) * _FINE / (_SQUARE * per_m)).astype(int) for at, start in
                zip((columns, rows), inner, strict=True)]  # fmt: skip
        ends = [_FINE * (n - 2 * _RING) - _GAP for n in self.squares]
        middle = (fine[0] >= _GAP) & (fine[1] >= _GAP) & (fine[0] < ends[0]) & (fine[1] < ends[1])
        page[middle] = np.where((fine[0] + fine[1]) % 2, 255, 0)[middle]
        self._write_below(page, v + ring[1], per_m)
        return page

    def _write_below(self, page: NDArray[np.uint8], bottom: int, per_m: float) -> None:
        """The scale bar in the middle of the margin, and a line on how to print."""
        width, mm = page.shape[1], per_m / 1000
        left, right = (round(0.5 * width + side * 0.5 * _BAR * per_m) for side in (-1, 1))
        bar = bottom + round(3.0 * mm)
        thick = max(1, round(0.35 * mm))
        page[bar - thick : bar + thick, left:right] = 0
        for end in (left, right - thick):
            page[bar - round(1.2 * mm) : bar + round(1.2 * mm), end : end + thick] = 0
        text = (
            f"Print at 100 %, not fitted to the page. The bar is {1000 * _BAR:.0f} mm long; else say how long: bar=..."
        )
        letters = 2.0 * mm / 22
        (wide, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, letters, 1)
        at = ((width - wide) // 2, bar + round(4.6 * mm))
        cv2.putText(page, text, at, cv2.FONT_HERSHEY_SIMPLEX, letters, 0, max(1, round(0.2 * mm)), cv2.LINE_AA)

    @checked
    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the sheet as a PDF or PNG, by the name's ending.

        Parameters
        ----------
        path
            File to write, ``.pdf`` or ``.png``.
        """
        path = Path(path)
        kind = path.suffix.lower()
        if kind not in (".pdf", ".png"):
            raise InvalidParameterError(f"a sheet is written as .pdf or .png; got {path.name!r}")
        page = self.image(_DPI)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if kind == ".pdf":
                path.write_bytes(_pdf(page, _PAPERS[self.paper]))
            else:
                written, encoded = cv2.imencode(".png", page)
                assert written
                path.write_bytes(encoded.tobytes())
        except OSError as error:
            raise InvalidParameterError(f"{path} cannot be written: {error.strerror}") from error
        return path


def printed(sheet: Sheet, cell: float) -> NDArray[np.float64]:
    """How white each cell of a sheet is, from 0 to 1, row by row from the upper left; sides of cells in m."""
    width, height = (round(side / cell) for side in sheet.size)
    page = sheet.image(_DPI / 2).astype(np.float32) / 255
    return np.asarray(cv2.resize(page, (width, height), interpolation=cv2.INTER_AREA), float)


def _pdf(page: NDArray[np.uint8], size: tuple[float, float]) -> bytes:
    """A PDF of one page, m, that a picture of black and white fills."""
    width, height = (side / 0.0254 * 72 for side in size)  # points
    bits = zlib.compress(np.packbits(page > 127, axis=1).tobytes(), 9)
    draw = f"{width:.3f} 0 0 {height:.3f} 0 0 cm /Page Do".encode()
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        b"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 %.3f %.3f] /Contents 4 0 R "
        b"/Resources << /XObject << /Page 5 0 R >> >> >>" % (width, height),
        b"<< /Length %d >>\nstream\n%s\nendstream" % (len(draw), draw),
        b"<< /Type /XObject /Subtype /Image /Width %d /Height %d /ColorSpace /DeviceGray /BitsPerComponent 1 "
        b"/Filter /FlateDecode /Length %d >>\nstream\n%s\nendstream" % (page.shape[1], page.shape[0], len(bits), bits),
    ]
    file, starts = b"%PDF-1.4\n", []
    for number, body in enumerate(objects, start=1):
        starts.append(len(file))
        file += b"%d 0 obj\n%s\nendobj\n" % (number, body)
    table = b"".join(b"%010d 00000 n \n" % start for start in starts)
    end = b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (len(objects) + 1, len(file))
    return file + b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1) + table + end
