"""From images to blobs. Thesis 2.1, shared by both planners.

Segmenters turn an image into a mask (``HsvThreshold``, ``Saliency``, ``BoxSegmenter``, or any function of your own);
for things of many colors there are ``GrabCut``, ``LearnedSegmenter``, and ``Whole``, which makes whole what another one
finds. ``Blob`` holds a mask's moments, and ``Tracker`` follows one of several objects. ``images`` checks images and
masks where they enter the library, and crops and resizes what networks see.
"""

from gvp_lib.perception.blobs import Blob, Tracker, blobs_from_mask
from gvp_lib.perception.hsv import rgb_to_hsv
from gvp_lib.perception.images import center_crop, crop_and_resize
from gvp_lib.perception.outlines import Outline
from gvp_lib.perception.segmentation import BoxSegmenter, HsvThreshold, Saliency, Segmenter
from gvp_lib.perception.whole import GrabCut, LearnedSegmenter, Whole

__all__ = [
    "Blob",
    "BoxSegmenter",
    "GrabCut",
    "HsvThreshold",
    "LearnedSegmenter",
    "Outline",
    "Saliency",
    "Segmenter",
    "Tracker",
    "Whole",
    "blobs_from_mask",
    "center_crop",
    "rgb_to_hsv",
    "crop_and_resize",
]
