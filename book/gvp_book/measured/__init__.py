"""What this project measured in real pictures, which are not its own and not here: outlines, poses, marks.

Each file beside this one names where its pictures come from.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arc import Arc
from gvp_lib.motion.sighting import View
from gvp_lib.perception.blobs import blobs_from_mask
from gvp_lib.perception.outlines import Outline

__all__ = ["Box", "Measured", "carton", "circles", "tissue_box", "tissue_face", "view_of"]

_FINE = 4  # bits of a pixel's fraction, in which OpenCV fills a polygon


@dataclass(frozen=True, eq=False)
class Box:
    """A box through corners that were marked by hand.

    Attributes
    ----------
    base_from_box
        Pose of its center.
    sizes
        Lengths along its axes, shape (3,), m.
    """

    base_from_box: RigidTransform
    sizes: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Measured:
    """Views that were measured in real pictures.

    Attributes
    ----------
    views
        Views, without pictures and colors.
    intrinsics
        Camera's lens.
    """

    views: tuple[View, ...]
    intrinsics: CameraIntrinsics

    @property
    def arc(self) -> Arc:
        """The views as estimators take them."""
        return Arc.of(self.views)


def carton(outlines: Literal["whole", "largest_region"] = "whole") -> tuple[Measured, Box]:
    """Forty views of a printed carton on a sheet of markers by a telephone, in the sheet's frame, and the carton.

    Parameters
    ----------
    outlines
        ``"largest_region"`` that a threshold of hue leaves, with the holes and notches that the print cuts; or
        ``"whole"``, its convex hull.
    """
    data = _read("carton")
    poses = [view["base_from_camera"] for view in data["views"]]
    box = data["by_hand"]
    pose = RigidTransform.from_components(box["center"], Rotation.from_matrix(box["rotation"]))
    return _measured(data, poses, [view[outlines] for view in data["views"]]), Box(pose, np.array(box["sizes"]))


def tissue_box(poses: Literal["arm_poses", "calibrated_poses"] = "arm_poses") -> tuple[Measured, NDArray[np.float64]]:
    """Twelve views of a tissue box by the camera in a real arm's hand, and its front face's outward normal, base frame.

    The normal is that of the plane through its corners, which were marked by hand, seen with the same poses.

    Parameters
    ----------
    poses
        ``"arm_poses"``, as that arm believes them, or ``"calibrated_poses"``.
    """
    data = _read("tissue_box")
    outlines = data["outlines"]["silhouette"]
    numbers = sorted(outlines, key=int)
    measured = _measured(data, [data[poses][int(k)] for k in numbers], [outlines[k] for k in numbers])
    return measured, tissue_face([view.base_from_camera for view in measured.views])


def tissue_face(cameras: Sequence[RigidTransform]) -> NDArray[np.float64]:
    """Outward normal of the tissue box's front face by its marked corners, shape (3,), for poses of twelve views."""
    data = _read("tissue_box")
    lens, outlines = _lens(data), data["outlines"]
    marked = [outlines["front_face"][k] for k in sorted(outlines["silhouette"], key=int)]
    points = []
    for corner in range(4):
        rays = [c.rotation.apply(lens.rays(np.array(m[corner]))) for c, m in zip(cameras, marked, strict=True)]
        across = [np.eye(3) - np.outer(ray, ray) / (ray @ ray) for ray in rays]
        at = np.sum([a @ c.translation for a, c in zip(across, cameras, strict=True)], axis=0)
        points.append(np.linalg.solve(np.sum(across, axis=0), at))
    a, b, c, d = points
    normal = np.cross(c - a, d - b)
    toward = np.mean([camera.translation for camera in cameras], axis=0) - np.mean(points, axis=0)
    return np.asarray(normal * np.sign(normal @ toward) / np.linalg.norm(normal))


def circles() -> tuple[RigidTransform, NDArray[np.float64], NDArray[np.float64], CameraIntrinsics]:
    """Fifteen pictures of a 10 x 10 grid of circles by a real arm: ``base_from_hand`` of each; the grid's points about
    its middle, shape (100, 3), m; their centers, shape (15, 100, 2), px; and the lens."""
    data = _read("hand_eye_circles")
    grid = np.pad(np.mgrid[:10, :10].T.reshape(-1, 2) - 4.5, ((0, 0), (0, 1))) * data["spacing_m"]
    return RigidTransform.from_matrix(data["base_from_hand"]), grid, np.array(data["centers"]), _lens(data)


def _read(name: str) -> dict[str, Any]:
    data: dict[str, Any] = json.loads(Path(__file__).with_name(f"{name}.json").read_text("utf-8"))
    return data


def _lens(data: dict[str, Any]) -> CameraIntrinsics:
    return CameraIntrinsics(**{name: data["lens"][name] for name in ("width", "height", "fx", "fy", "cx", "cy")})


def view_of(
    outline: Sequence[Sequence[float]] | NDArray[np.float64], base_from_camera: RigidTransform, lens: CameraIntrinsics
) -> View:
    """The view whose silhouette has an outline, a polygon of corners (u, v), px: without picture and colors."""
    mask = np.zeros((lens.height, lens.width), np.uint8)
    cv2.fillPoly(mask, [(np.array(outline, float) * 2**_FINE).round().astype(np.int32)], 1, shift=_FINE)
    (blob,) = blobs_from_mask(mask.view(np.bool_))
    return View(np.empty(0), base_from_camera, blob, outline=Outline.of(blob, mask.shape))


def _measured(data: dict[str, Any], poses: Sequence[Any], outlines: Sequence[Any]) -> Measured:
    lens = _lens(data)
    cameras = [RigidTransform.from_matrix(pose) for pose in poses]
    return Measured(tuple(view_of(each, pose, lens) for each, pose in zip(outlines, cameras, strict=True)), lens)
