"""A detector that only gives bounding boxes, as a segmenter. Thesis 2.1."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gvp_lib.errors import InvalidParameterError
from gvp_lib.perception.images import check_rgb

__all__ = ["BoxSegmenter"]


@dataclass(frozen=True)
class BoxSegmenter:
    """A detector that only gives bounding boxes, as a segmenter: the mask is the filled box.

    Thesis 2.1: any method that outputs bounding boxes will do. A filled box is enough to center the camera and for
    the learned planner. It is not enough for the image-moment planner: an upright box has the orientation of the
    image and not of the object, and its ratio is not the object's.

    Attributes
    ----------
    detect
        RGB uint8 (H, W, 3) to boxes ``(u0, v0, u1, v1)`` or ``(u0, v0, u1, v1, score)`` in pixels, u1 and v1
        exclusive.
    min_score
        Boxes that score less are dropped; a box without a score is kept.
    every
        Fill every box, for a tracker to choose from. Otherwise only the one of the highest score, or where boxes
        have no score the largest.
    """

    detect: Callable[[NDArray[np.uint8]], Sequence[Sequence[float]]]
    min_score: float = 0.0
    every: bool = False

    def __call__(self, rgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """The mask, bool (H, W); empty where nothing is detected."""
        rgb = check_rgb(rgb)
        boxes = []
        for box in self.detect(rgb):
            box = tuple(float(x) for x in box)
            if len(box) not in (4, 5) or not np.isfinite(box).all() or box[2] < box[0] or box[3] < box[1]:
                raise InvalidParameterError(
                    "a detector gives boxes (u0, v0, u1, v1) or (u0, v0, u1, v1, score) with u0 <= u1 and v0 <= v1; "
                    f"got {box}. From (u, v, width, height): (u, v, u + width, v + height)"
                )
            if len(box) == 4 or box[4] >= self.min_score:
                boxes.append(box)
        if boxes and not self.every:
            boxes = [max(boxes, key=lambda b: b[4] if len(b) == 5 else (b[2] - b[0]) * (b[3] - b[1]))]
        mask = np.zeros(rgb.shape[:2], np.bool_)
        for box in boxes:
            u0, v0, u1, v1 = (max(0, round(x)) for x in box[:4])
            mask[v0:v1, u0:u1] = True
        return mask
