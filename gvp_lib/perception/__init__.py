"""Images in, blobs out: thesis 2.1, shared by both planners."""

from gvp_lib.perception.images import cropped, shrunk
from gvp_lib.perception.moments import Blob
from gvp_lib.perception.segmentation import BoxSegmenter, HsvThreshold, Saliency, Segmenter, rgb_to_hsv
from gvp_lib.perception.tracking import Region, Tracker, blobs_from_mask, regions_from_mask

__all__ = [
    "Blob",
    "BoxSegmenter",
    "HsvThreshold",
    "Region",
    "Saliency",
    "Segmenter",
    "Tracker",
    "blobs_from_mask",
    "cropped",
    "regions_from_mask",
    "rgb_to_hsv",
    "shrunk",
]
