"""The outline of a silhouette to a fraction of a pixel, and the colors just outside it, which tell what hides what."""

from __future__ import annotations

from dataclasses import dataclass

import contourpy
import cv2
import numpy as np
from numpy.typing import NDArray

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError
from gvp_lib.perception.blobs import Blob, image_size
from gvp_lib.perception.images import check_rgb
from gvp_lib.picture import count

__all__ = ["Outline"]

_SIGMA = 1.0  # px, of the blur that makes an edge of steps a slope
_PAD = 4  # px about the blob's box, for the blur
_BORDER = 2.0  # px: as near to the image's border, the outline is that of the picture
_OUTSIDE = 4.0  # px: so far out, a picture's own blur has ended


@checked
@dataclass(frozen=True, eq=False)
class Outline:
    """Outer contour of a blob as points at even distances, clockwise on screen.

    Attributes
    ----------
    points
        Points (u, v), shape (n, 2), px.
    inside
        Whether the point is the object's own edge, shape (n,): not where the image's border cuts the blob.
    colors
        CIELAB color of the picture 4 px outside of each point, shape (n, 3): L in 0...100. NaN where it was not asked
        for, or lies outside of the picture.

    Examples
    --------
    >>> mask = np.zeros((480, 640), bool)
    >>> mask[200:220, 300:360] = True
    >>> outline = Outline.of(Blob.from_mask(mask), (480, 640))
    >>> outline
    Outline(40 points, 40 inside)
    >>> outline.points.min(0).round(1).tolist(), outline.points.max(0).round(1).tolist()
    ([299.5, 199.5], [359.5, 219.5])
    """

    points: NDArray[np.float64]
    inside: NDArray[np.bool_]
    colors: NDArray[np.float64]

    def __repr__(self) -> str:
        return f"Outline({count(len(self.points), 'point')}, {int(self.inside.sum())} inside)"

    @classmethod
    def of(cls, blob: Blob, image: NDArray[np.uint8] | tuple[int, int], *, count: int = 40) -> Outline:
        """Trace the longest contour of a blob at half height.

        Parameters
        ----------
        blob
            Blob with its pixels.
        image
            Picture, uint8 (H, W, 3), or its shape (H, W) alone; then there are no colors.
        count
            Number of points.

        Raises
        ------
        InvalidParameterError
            The blob has moments alone or lies outside of the image, or there are fewer than three points.
        """
        picture = None if isinstance(image, tuple) else check_rgb(image)
        height, width = image_size(image) if isinstance(image, tuple) else image.shape[:2]
        u0, v0, u1, v1 = blob.bbox
        if blob.pixels is None or count < 3 or min(u0, v0, width - u1, height - v1) < 0:
            raise InvalidParameterError(
                "an outline has three points or more, of a blob with its pixels within the image; got "
                f"{blob!r}, an image of {width} x {height} px and count={count}"
            )
        # Where the border cuts the blob, it goes on behind it; beyond the pad it ends, so that the contour closes.
        within = [(min(_PAD, v0), min(_PAD, height - v1)), (min(_PAD, u0), min(_PAD, width - u1))]
        beyond = [(_PAD + 1 - low, _PAD + 1 - high) for low, high in within]
        pixels = np.pad(np.pad(blob.pixels.astype(np.float32), within), beyond, mode="edge")
        pixels[[0, -1]], pixels[:, [0, -1]] = 0.0, 0.0
        level = cv2.GaussianBlur(pixels, (0, 0), _SIGMA)
        level[[0, -1]], level[:, [0, -1]] = 0.0, 0.0
        # The blur leaves of a blob a pixel or two wide nothing that reaches half height.
        lines = contourpy.contour_generator(z=level).lines(0.5) or contourpy.contour_generator(z=pixels).lines(0.5)
        line = max(map(np.asarray, lines), key=lambda each: abs(_area(each)))
        if _area(line) < 0:
            line = line[::-1]
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
        at = (np.arange(count) + 0.5) * along[-1] / count
        points = np.column_stack([np.interp(at, along, line[:, k]) for k in (0, 1)]) - (_PAD + 1) + (u0, v0)
        far = np.array([width, height]) - 1.0 - _BORDER
        inside = np.asarray(((points > _BORDER) & (points < far)).all(axis=1))
        colors = np.full((count, 3), np.nan)
        if picture is not None:
            tangent = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
            outward = np.column_stack([tangent[:, 1], -tangent[:, 0]]) / np.hypot(*tangent.T)[:, None].clip(1e-9)
            u, v = (points + _OUTSIDE * outward).round().astype(int).T
            shown = (u >= 0) & (v >= 0) & (u < width) & (v < height)
            if shown.any():
                rgb = picture[v[shown], u[shown]].astype(np.float32)[None] / 255
                colors[shown] = cv2.cvtColor(rgb, cv2.COLOR_RGB2LAB)[0]
        return cls(points, inside, colors)


def _area(line: NDArray[np.float64]) -> float:
    """Twice the area within a closed line, positive where it runs clockwise on screen."""
    (x, y), (x1, y1) = line[:-1].T, line[1:].T
    return float(x @ y1 - x1 @ y)
