"""Segment and describe one 640 x 480 frame: ours, the same bare OpenCV calls, and scikit-image; and ``import gvp_lib``.

Run as ``python tests/benchmarks/perception.py``. Aims: at most 1.15 of the bare calls, a quarter of scikit-image's time
or less, and an import within 0.3 s of Python's own start.
"""

from __future__ import annotations

import subprocess
import sys

import cv2
import numpy as np
from harness import command, interleave, verdict
from skimage.color import rgb2hsv
from skimage.measure import label, regionprops

from gvp_lib.perception.blobs import Blob, Tracker
from gvp_lib.perception.segmentation import HsvThreshold, Saliency

OPENCV_AIM, SCIKIT_AIM, IMPORT_AIM = 1.15, 4.0, 0.3  # of our ratio; of theirs to ours; s


def frame() -> np.ndarray:
    """A blue brick, turned by 30 degrees, on a wooden table with noise; uint8 (480, 640, 3)."""
    image = np.full((480, 640, 3), (150, 120, 90), np.uint8)
    corners = cv2.boxPoints(((330, 250), (150, 75), 30)).round().astype(np.int32)
    cv2.fillPoly(image, [corners], (30, 60, 170))
    noise = np.random.default_rng(0).normal(0, 3, image.shape)
    return (image + noise).clip(0, 255).astype(np.uint8)


RGB = frame()
KERNEL = np.ones((3, 3), np.uint8)


def bare(boxed: bool = False) -> dict[str, float]:
    """OpenCV alone; ``boxed`` with our own trick, the moments of the bounding box alone."""
    hsv = cv2.cvtColor(RGB, cv2.COLOR_RGB2HSV)
    mask = cv2.inRange(hsv, (100, 102, 51), (120, 255, 255))
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, KERNEL)
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, KERNEL)
    u, v, w, h = cv2.boundingRect(mask) if boxed else (0, 0, 640, 480)
    return cv2.moments(mask[v : v + h, u : u + w], True)


def scikit_image() -> object:
    """The thresholds, the regions and the largest one's axes; not even opened and closed."""
    h, s, v = np.moveaxis(rgb2hsv(RGB), -1, 0)
    mask = (h >= 200 / 360) & (h <= 240 / 360) & (s >= 0.4) & (v >= 0.2)
    region = max(regionprops(label(mask)), key=lambda r: r.area)
    return region.centroid, region.orientation, region.axis_major_length, region.axis_minor_length


def ours(segmenter: HsvThreshold | Saliency) -> object:
    blob = Blob.from_mask(segmenter(RGB))
    return blob and (blob.centroid, blob.orientation, blob.axis_major_length, blob.axis_minor_length)


def main() -> None:
    """Print the tables."""
    blue = HsvThreshold((200, 240), (0.4, 1), (0.2, 1))
    tracker = Tracker(blue)
    rivals = {
        "OpenCV": bare,
        "OpenCV, boxed moments": lambda: bare(boxed=True),
        "gvp_lib": lambda: ours(blue),
        "gvp_lib, tracked": lambda: tracker.observe(RGB),
        "gvp_lib, saliency": lambda: ours(Saliency()),
        "scikit-image": scikit_image,
    }
    results = interleave(rivals)
    verdict("gvp_lib / OpenCV", results["gvp_lib"].ratio, OPENCV_AIM)
    verdict("scikit-image / gvp_lib", results["scikit-image"].ratio / results["gvp_lib"].ratio, SCIKIT_AIM, least=True)
    print("A fresh Python that runs one statement")
    statements = ("pass", "import gvp_lib", "import gvp_lib.cli", "from gvp_lib import CameraIntrinsics")
    fresh = {s: lambda s=s: subprocess.run([sys.executable, "-c", s], check=True) for s in statements}
    results = interleave(fresh, rounds=15, calls=1)
    verdict("import gvp_lib, s more", results["import gvp_lib"].median - results["pass"].median, IMPORT_AIM)


if __name__ == "__main__":
    command(main, {})
