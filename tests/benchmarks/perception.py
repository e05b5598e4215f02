"""Segment and describe one 640 x 480 frame: ours, the same bare OpenCV calls, and scikit-image.

Run as ``python tests/benchmarks/perception.py``.
"""

from __future__ import annotations

import cv2
import numpy as np
from harness import interleave
from skimage.color import rgb2hsv
from skimage.measure import label, regionprops

from gvp_lib.perception.moments import Blob
from gvp_lib.perception.segmentation import HsvThreshold, Saliency
from gvp_lib.perception.tracking import Tracker


def frame() -> np.ndarray:
    """A blue brick, turned by 30 degrees, on a wooden table with noise; uint8 (480, 640, 3)."""
    image = np.full((480, 640, 3), (150, 120, 90), np.uint8)
    corners = cv2.boxPoints(((330, 250), (150, 75), 30)).round().astype(np.int32)
    cv2.fillPoly(image, [corners], (30, 60, 170))
    noise = np.random.default_rng(0).normal(0, 3, image.shape)
    return (image + noise).clip(0, 255).astype(np.uint8)


RGB = frame()
BLUE, RED = (200, 240), (345, 15)  # deg
SATURATION, VALUE = (0.4, 1), (0.2, 1)
KERNEL = np.ones((3, 3), np.uint8)


def bare(ranges: list[tuple[tuple[int, int, int], tuple[int, int, int]]]) -> dict[str, float]:
    hsv = cv2.cvtColor(RGB, cv2.COLOR_RGB2HSV)
    mask = cv2.inRange(hsv, *ranges[0])
    for low, high in ranges[1:]:
        mask = cv2.bitwise_or(mask, cv2.inRange(hsv, low, high))
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, KERNEL)
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, KERNEL)
    return cv2.moments(mask, True)


def bare_boxed() -> dict[str, float]:
    """The bare calls with our own trick, the moments of the bounding box alone."""
    hsv = cv2.cvtColor(RGB, cv2.COLOR_RGB2HSV)
    mask = cv2.inRange(hsv, (100, 102, 51), (120, 255, 255))
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, KERNEL)
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, KERNEL)
    u, v, w, h = cv2.boundingRect(mask)
    return cv2.moments(mask[v : v + h, u : u + w], True)


def scikit_image() -> object:
    """The thresholds, the regions and the largest one's axes; not even opened and closed."""
    hsv = rgb2hsv(RGB)
    h, s, v = hsv[..., 0], hsv[..., 1], hsv[..., 2]
    mask = (h >= 200 / 360) & (h <= 240 / 360) & (s >= 0.4) & (v >= 0.2)
    region = max(regionprops(label(mask)), key=lambda r: r.area)
    return region.centroid, region.orientation, region.axis_major_length, region.axis_minor_length


def ours(segmenter: HsvThreshold | Saliency) -> object:
    blob = Blob.from_mask(segmenter(RGB))
    return blob and (blob.centroid, blob.orientation, blob.axis_major_length, blob.axis_minor_length)


def main() -> None:
    blue, red = HsvThreshold(BLUE, SATURATION, VALUE), HsvThreshold(RED, SATURATION, VALUE)
    tracker = Tracker(blue)
    print("One range of hue (aim: at most 1.15; scikit-image at least 4)")
    results = interleave(
        {
            "OpenCV": lambda: bare([((100, 102, 51), (120, 255, 255))]),
            "OpenCV, boxed moments": bare_boxed,
            "gvp_lib": lambda: ours(blue),
            "gvp_lib, tracked": lambda: tracker.observe(RGB),
            "gvp_lib, saliency": lambda: ours(Saliency()),
            "scikit-image": scikit_image,
        }
    )
    ratio = results["gvp_lib"].ratio
    print(f"gvp_lib / OpenCV {ratio:.2f}; scikit-image / gvp_lib {results['scikit-image'].ratio / ratio:.1f}\n")
    print("A range that wraps through red")
    interleave(
        {
            "OpenCV, two ranges": lambda: bare([((0, 102, 51), (7, 255, 255)), ((172, 102, 51), (179, 255, 255))]),
            "gvp_lib": lambda: ours(red),
        }
    )


if __name__ == "__main__":
    main()
