"""From photographs of an object on a sheet to views of it: where each was taken from, and the object's outline."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation
from tqdm import tqdm

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidImageError, InvalidParameterError
from gvp_lib.geometry.board import Board, Found, as_board, locate
from gvp_lib.geometry.calibration import Calibration, fit_lens, pose_of
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.arc import Arc
from gvp_lib.motion.sighting import THUMBNAIL, View
from gvp_lib.perception.blobs import blobs_from_mask
from gvp_lib.perception.images import check_mask
from gvp_lib.perception.outlines import Outline
from gvp_lib.perception.segmentation import Segmenter
from gvp_lib.perception.whole import GrabCut
from gvp_lib.photographs.background import silhouettes
from gvp_lib.photographs.sheet import Sheet
from gvp_lib.picture import Pictured, count

__all__ = ["Photographs", "views_from_photographs"]

_LONGER = 1600  # px of a picture's longer side, to which it is reduced once the sheet is found
_OF_VIEWS = 800  # px of a view's longer side: estimators were tuned to pictures of about that size
_FEWEST, _MOST = 3, 100
_PICTURES = {".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp"}
_OTHERS = {
    **dict.fromkeys((".heic", ".heif"), "is HEIC, which few programs read: have the telephone write JPEG, or convert"),
    **dict.fromkeys((".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v"), "is a video: take pictures, or export some"),
    **dict.fromkeys((".dng", ".cr2", ".nef", ".arw", ".raw"), "is raw: export JPEG"),
}
_SHARP = 0.45  # share of the other pictures' sharpness below which one is blurred
_OFF, _TIMES = 2.0, 4.0  # px, and times the others, by which the sheet's corners may be off
_SECOND = 0.25  # of the object's area, from which another region is another thing
_APART = 0.12  # of the object's extent, by which lines of sight may miss where the others meet
_SHEET_FROM_BOARD = RigidTransform.from_rotation(Rotation.from_rotvec([np.pi, 0, 0]))


@dataclass(frozen=True, eq=False)
class Photographs(Pictured):
    """Views of an object from photographs of it on a sheet, and what became of the others.

    Attributes
    ----------
    views
        Views in the sheet's frame (``base_from_camera`` is ``sheet_from_camera``), each with its picture, without
        distortion and reduced; ``joints`` are empty.
    intrinsics
        Pinhole of the views' pictures.
    lens
        Lens of the photographs as they came.
    files
        Name of each view's photograph.
    skipped
        Why each of the other photographs could not be used, by name.
    """

    _figure = "plot_photographs"

    views: tuple[View, ...]
    intrinsics: CameraIntrinsics
    lens: Calibration
    files: tuple[str, ...]
    skipped: Mapping[str, str] = field(default_factory=dict)

    @property
    def arc(self) -> Arc:
        """The views as estimators take them: an arc without an axis, whose center is the view most from above."""
        down = [view.line_of_sight[2] for view in self.views]
        return Arc.of(self.views, int(np.argmin(down)) if down else 0)

    def __repr__(self) -> str:
        without = f", {len(self.skipped)} not used" if self.skipped else ""
        return f"Photographs({count(len(self.views), 'view')}{without}, fx {self.lens.intrinsics.fx:.0f} px)"


@dataclass(frozen=True, eq=False)
class _Shot:
    """A photograph, reduced, in which the sheet was found."""

    name: str
    rgb: NDArray[np.uint8]
    size: tuple[int, int]  # as it came, px
    found: Found


@checked(own=True)
def views_from_photographs(
    files: str | os.PathLike[str] | Iterable[str | os.PathLike[str] | NDArray[np.uint8]],
    sheet: Sheet | Board | None = None,
    segmenter: Segmenter | None = None,
    lens: Calibration | None = None,
    *,
    progress: bool = False,
) -> Photographs:
    """Find out where photographs of an object on a sheet were taken from, and the object in each.

    Ten are a good number, from all around and from two heights, each with the whole object and much of the sheet in it.
    Neither may be moved between them; the camera's zoom stays as it is.

    Parameters
    ----------
    files
        Folder of photographs; or several of them, files or RGB uint8 (H, W, 3). Files are read as the sensor took them,
        whatever way their EXIF tag turns them.
    sheet
        Sheet that the object stands on, or any other board with its lengths in meters; None: ``Sheet("a4")``.
    segmenter
        RGB uint8 (H, W, 3) to mask bool (H, W); None: whatever differs from the sheet, which takes a :class:`Sheet`. A
        :class:`gvp_lib.perception.GrabCut` without a start begins from that.
    lens
        Calibrated lens of the photographs as they come; None: it is calibrated from the same photographs.
    progress
        Whether to show a progress bar.

    Returns
    -------
    Photographs
        Views in the sheet's frame, of three photographs or more.

    Raises
    ------
    InvalidImageError
        There are too few that can be used; the text has a line for each of the others.
    CalibrationError
        All were taken from nearly the same side, or they do not tell what the lens is like in its outer part.

    Examples
    --------
    >>> photos = views_from_photographs("desk", Sheet("a4"))  # doctest: +SKIP
    >>> ContourFit().estimate([photos.arc], photos.intrinsics)  # doctest: +SKIP
    """
    sheet = Sheet() if sheet is None else sheet
    board = sheet.board if isinstance(sheet, Sheet) else as_board(sheet)
    cut = segmenter if isinstance(segmenter, GrabCut) and segmenter.start is None else None
    by_sheet = segmenter is None or cut is not None
    if by_sheet and not isinstance(sheet, Sheet):
        raise InvalidParameterError(
            "what differs from a board is known of a Sheet alone; with any other give a segmenter, RGB to mask"
        )
    if lens is not None and not isinstance(lens, Calibration):
        raise InvalidParameterError(f"a lens is a Calibration, as calibrate(...) returns it; got {type(lens).__name__}")
    named = _named(files)
    skipped: dict[str, str] = {}
    shots = _shots(named, board, skipped, progress)
    shots = _of_one_size(shots, lens, skipped)
    shots = _sharp(shots, skipped)
    _enough(shots, skipped, "show the sheet well enough")
    if lens is None:
        lens = fit_lens({k: shot.found for k, shot in enumerate(shots)}, shots[0].size)
    shots, poses = _placed(shots, lens, skipped)
    _enough(shots, skipped, "fit the sheet")
    pinhole, pictures = _undistorted(shots, lens)
    if by_sheet:
        assert isinstance(sheet, Sheet)
        masks = silhouettes(pictures, poses, pinhole, sheet)
        if cut is not None:
            masks = [cut.refined(picture, mask) for picture, mask in zip(pictures, masks, strict=True)]
    else:
        assert segmenter is not None
        masks = [check_mask(segmenter(picture), picture.shape[:2]) for picture in pictures]
    pinhole, pictures, masks = _reduced(pinhole, pictures, masks)
    views, names = [], []
    for shot, pose, picture, mask in zip(shots, poses, pictures, masks, strict=True):
        # What is around the object is print or wood, and never plain: its colors would not tell what hides what.
        if isinstance(view := view_of(pose, picture, mask, colors=False), str):
            skipped[shot.name] = view
        else:
            views.append(view)
            names.append(shot.name)
    for k, reason in _moved(views, pinhole).items():
        skipped[names[k]] = reason
    kept = [k for k, name in enumerate(names) if name not in skipped]
    _enough(kept, skipped, "show the whole object")
    order = {name: skipped[name] for name in named if name in skipped}
    return Photographs(tuple(views[k] for k in kept), pinhole, lens, tuple(names[k] for k in kept), order)


def _named(files: Any) -> dict[str, Any]:
    """Photographs by name: files, or arrays."""
    if isinstance(files, str | os.PathLike):
        folder = Path(files)
        if not folder.is_dir():
            one = f"one file, {str(files)!r}: a single view tells no solid" if folder.is_file() else f"{str(files)!r}"
            raise InvalidImageError(f"photographs are a folder, or several files in a list; got {one}")
        given: list[Any] = sorted(
            path for path in folder.iterdir() if path.suffix.lower() in _PICTURES | _OTHERS.keys() and path.is_file()
        )
        if not given:
            raise InvalidImageError(f"{folder} holds no photographs: no file ends in {', '.join(sorted(_PICTURES))}")
    elif isinstance(files, np.ndarray) or not isinstance(files, Iterable):
        raise InvalidImageError(
            f"photographs are a folder, or several files or arrays in a list; got {type(files).__name__}"
        )
    else:
        given = list(files)
    if not _FEWEST <= len(given) <= _MOST:
        much = "Ten to forty, from all around, are enough" if len(given) > _MOST else "Ten are a good number"
        raise InvalidImageError(f"photographs are {_FEWEST} to {_MOST}; got {len(given)}. {much}")
    paths = [isinstance(each, str | os.PathLike) for each in given]
    short = Counter(Path(each).name for each, path in zip(given, paths, strict=True) if path)
    return {
        (Path(each).name if short[Path(each).name] == 1 else str(each)) if path else f"number {k}": each
        for k, (each, path) in enumerate(zip(given, paths, strict=True))
    }


def _shots(named: Mapping[str, Any], board: Board, skipped: dict[str, str], progress: bool) -> list[_Shot]:
    """Photographs that show the sheet; reasons of the others go into ``skipped``."""
    shots = []
    for name, given in tqdm(named.items(), "photographs", disable=not progress, unit=""):
        rgb = _read(given)
        if isinstance(rgb, str):
            skipped[name] = rgb
            continue
        height, width = rgb.shape[:2]
        gray = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), np.uint8)
        found = locate(gray, board)
        if found is None:
            skipped[name] = _why_no_sheet(gray, board)
            continue
        scale = min(1.0, _LONGER / max(height, width))
        to = round(scale * width), round(scale * height)
        small = cv2.resize(rgb, to, interpolation=cv2.INTER_AREA) if scale < 1 else rgb
        shots.append(_Shot(name, np.asarray(small, np.uint8), (width, height), found))
    return shots


def _read(given: Any) -> NDArray[np.uint8] | str:
    """Picture in RGB, or why there is none."""
    if isinstance(given, np.ndarray):
        right = given.dtype == np.uint8 and given.ndim == 3 and given.shape[2] == 3 and given.size
        return given if right else f"is no RGB picture, uint8 (H, W, 3), but {given.dtype} {given.shape}"
    if not isinstance(given, str | os.PathLike):
        return f"is neither a file nor an array, but {type(given).__name__}"
    path = Path(given)
    if path.suffix.lower() in _OTHERS:
        return _OTHERS[path.suffix.lower()]
    if not path.is_file():
        return "is no file"
    rgb = cv2.imread(str(path), cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION)
    return "is no picture that OpenCV reads" if rgb is None else np.asarray(rgb, np.uint8)


def _why_no_sheet(gray: NDArray[np.uint8], board: Board) -> str:
    if isinstance(board, cv2.aruco.Board):
        detector = cv2.aruco.ArucoDetector(board.getDictionary())
        _, ids, _ = detector.detectMarkers(gray)
        seen = set() if ids is None else {int(each) for each in np.ravel(ids)}
        ours = seen & {int(each) for each in np.ravel(board.getIds())}
        if len(seen - ours) > len(ours):
            return f"shows another sheet: {count(len(seen), 'marker')}, of which {len(ours)} are this one's"
        if seen:
            return f"shows too little of the sheet, or is blurred: {count(len(ours), 'marker')}"
    return "shows no sheet"


def _of_one_size(shots: list[_Shot], lens: Calibration | None, skipped: dict[str, str]) -> list[_Shot]:
    if not shots:
        return shots
    if lens is None:
        size, _ = Counter(shot.size for shot in shots).most_common(1)[0]
        of = "the others are"
    else:
        size, of = (lens.intrinsics.width, lens.intrinsics.height), "the lens takes"
    for shot in shots:
        if shot.size != size:
            turned = ": turned or cut after it was taken" if shot.size == size[::-1] else ""
            skipped[shot.name] = "is {} x {} px, where {} {} x {}{}".format(*shot.size, of, *size, turned)
    return [shot for shot in shots if shot.size == size]


def _sharp(shots: list[_Shot], skipped: dict[str, str]) -> list[_Shot]:
    """Those in which the sheet's edges are about as steep as in the others."""
    if not shots:
        return shots
    steep = []
    for shot in shots:
        gray = cv2.cvtColor(shot.rgb, cv2.COLOR_RGB2GRAY).astype(np.float32)
        scale = shot.rgb.shape[1] / shot.size[0]
        u0, v0 = np.maximum(0, (scale * shot.found[1].min(axis=0)).astype(int))
        u1, v1 = (scale * shot.found[1].max(axis=0)).astype(int) + 1
        part = gray[v0:v1, u0:u1]
        slope = np.hypot(cv2.Sobel(part, cv2.CV_32F, 1, 0), cv2.Sobel(part, cv2.CV_32F, 0, 1))
        steep.append(float(np.percentile(slope, 97) / max(1.0, float(np.ptp(np.percentile(part, (2, 98)))))))
    usual = float(np.median(steep))
    for shot, each in zip(shots, steep, strict=True):
        if each < _SHARP * usual:
            skipped[shot.name] = f"is blurred: its edges are {100 * each / usual:.0f} % as steep as the others'"
    return [shot for shot in shots if shot.name not in skipped]


def _placed(shots: list[_Shot], lens: Calibration, skipped: dict[str, str]) -> tuple[list[_Shot], list[RigidTransform]]:
    """Photographs that the sheet fits, and ``sheet_from_camera`` of each."""
    k, bent = lens.intrinsics.matrix, lens.distortion
    poses, off = [], []
    for shot in shots:
        camera_from_board = pose_of(shot.found, lens.intrinsics, bent)
        turn, shift = camera_from_board.rotation.as_rotvec(), camera_from_board.translation
        expected, _ = cv2.projectPoints(shot.found[0].astype(float), turn, shift, k, bent)
        off.append(float(np.sqrt(np.mean(np.sum((expected[:, 0] - shot.found[1]) ** 2, axis=1)))))
        poses.append((camera_from_board * _SHEET_FROM_BOARD.inv()).inv())
    most = max(_OFF * shots[0].size[0] / _LONGER, _TIMES * float(np.median(off)))
    for shot, each in zip(shots, off, strict=True):
        if each > most:
            skipped[shot.name] = f"shows a sheet that is not flat, or too little of it: corners off by {each:.3g} px"
    kept = [n for n, shot in enumerate(shots) if shot.name not in skipped]
    return [shots[n] for n in kept], [poses[n] for n in kept]


def _undistorted(shots: Sequence[_Shot], lens: Calibration) -> tuple[CameraIntrinsics, list[NDArray[np.uint8]]]:
    """Pinhole of the reduced pictures, and the pictures as it would take them."""
    pinhole = _resized(lens.intrinsics, shots[0].rgb.shape)
    width, height = pinhole.width, pinhole.height
    k = pinhole.matrix
    maps = cv2.initUndistortRectifyMap(k, lens.distortion, None, k, (width, height), cv2.CV_16SC2)
    pictures = [
        np.asarray(cv2.remap(shot.rgb, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8)
        for shot in shots
    ]
    return pinhole, pictures


def _resized(lens: CameraIntrinsics, shape: Sequence[int]) -> CameraIntrinsics:
    """Pinhole of a picture that was resized to (H, W)."""
    height, width = shape[:2]
    across, down = width / lens.width, height / lens.height
    cx, cy = (lens.principal_point + 0.5) * (across, down) - 0.5
    return CameraIntrinsics(width, height, across * lens.fx, down * lens.fy, float(cx), float(cy))


def _reduced(
    pinhole: CameraIntrinsics, pictures: list[NDArray[np.uint8]], masks: list[NDArray[np.bool_]]
) -> tuple[CameraIntrinsics, list[NDArray[np.uint8]], list[NDArray[np.bool_]]]:
    """All three at the size of views."""
    scale = min(1.0, _OF_VIEWS / max(pinhole.width, pinhole.height))
    to = round(scale * pinhole.width), round(scale * pinhole.height)
    return (
        _resized(pinhole, to[::-1]),
        [np.asarray(cv2.resize(picture, to, interpolation=cv2.INTER_AREA), np.uint8) for picture in pictures],
        [cv2.resize(mask.astype(np.float32), to, interpolation=cv2.INTER_AREA) > 0.5 for mask in masks],
    )


def view_of(
    pose: RigidTransform, picture: NDArray[np.uint8], mask: NDArray[np.bool_], *, colors: bool = True
) -> View | str:
    """View of the largest region of a mask, or why there is none."""
    blobs = blobs_from_mask(mask)
    if not blobs:
        return "shows no object"
    blob = blobs[0]
    if len(blobs) > 1 and blobs[1].area > _SECOND * blob.area:
        return f"shows two things, of {blob.area} and {blobs[1].area} px"
    if blob.touches_border(picture.shape):
        return "shows an object that the border of the picture cuts"
    small = picture[THUMBNAIL // 2 :: THUMBNAIL, THUMBNAIL // 2 :: THUMBNAIL].copy()
    outline = Outline.of(blob, picture if colors else mask.shape)
    return View(np.empty(0), pose, blob, False, picture, outline, small)


def _moved(views: Sequence[View], pinhole: CameraIntrinsics) -> dict[int, str]:
    """Views, by number, whose line of sight misses where the others meet."""
    if len(views) < _FEWEST:
        return {}
    origins = np.array([view.base_from_camera.translation for view in views])
    rays = np.array([view.base_from_camera.rotation.apply(pinhole.rays(view.blob.centroid)) for view in views])
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]  # what lies beside each ray
    weights = np.ones(len(views))
    for _ in range(20):  # the point nearest to most rays, the others counting less and less
        meeting = np.linalg.lstsq(
            np.einsum("n,nij->ij", weights, across), np.einsum("n,nij,nj->i", weights, across, origins), rcond=None
        )[0]
        misses = np.linalg.norm(np.einsum("nij,nj->ni", across, meeting - origins), axis=1)
        weights = 1 / np.maximum(misses, 1e-4)
    depth = np.einsum("ni,ni->n", rays, meeting - origins)
    extent = np.median([v.blob.axis_major_length / pinhole.fx * d for v, d in zip(views, depth, strict=True)])
    return {
        k: f"shows the object {1000 * miss:.0f} mm beside where the others see it: it or the sheet was moved"
        for k, miss in enumerate(misses)
        if miss > max(_APART * extent, 4 * float(np.median(misses)))
    }


def _enough(left: Sequence[Any], skipped: Mapping[str, str], what: str) -> None:
    if len(left) < _FEWEST:
        lines = "".join(f"\n  {name} {reason}" for name, reason in skipped.items())
        raise InvalidImageError(f"{_FEWEST} photographs or more must {what}; {len(left)} do{lines}")
