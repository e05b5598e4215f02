"""A recording as a film that plays anywhere: ``.mp4`` by OpenCV, ``.gif`` by Pillow, which comes with matplotlib."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from gvp_lib.errors import GvpError

__all__ = ["FILMS", "write_film"]

Draw = Callable[[Iterable[int]], Iterator[NDArray[np.uint8]]]  # RGB pictures (H, W, 3) of frames, by their numbers

_GIF_RATE = 20.0  # pictures per second at most: a GIF counts hundredths of a second, and grows with each picture
_CODECS = "vp09", "mp4v"  # VP9 plays in browsers; where OpenCV was built without it, MPEG-4 plays in most players


def write_film(path: Path, times: Sequence[float], rate: float, draw: Draw) -> None:
    """Write frames as a film; each stays until the next one's time has come.

    Parameters
    ----------
    path
        File to write, whose ending is one of :data:`FILMS`. It is replaced once the film is complete.
    times
        Time of each frame, s, ascending.
    rate
        Pictures per second at most.
    draw
        Draws frames, given their numbers in ascending order.

    Raises
    ------
    GvpError
        OpenCV was built without a codec for ``.mp4``.
    """
    ending = path.suffix.lower()
    rate = min(rate, _GIF_RATE) if ending == ".gif" else rate
    ticks = np.arange(np.ceil((times[-1] - times[0]) * rate - 1e-6) + 1) / rate  # s; the last frame is among them
    shown = np.searchsorted(np.subtract(times, times[0]), ticks + 1e-6, side="right") - 1
    frames, first = np.unique(shown, return_index=True)
    counts = np.diff(first, append=len(shown))  # ticks for which each of the frames is shown
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        made = Path(folder) / f"film{ending}"
        FILMS[ending](made, draw(frames), counts, rate)
        made.replace(path)


def _write_gif(path: Path, pictures: Iterator[NDArray[np.uint8]], counts: NDArray[np.int64], rate: float) -> None:
    from PIL import Image

    ends = np.rint(np.append(0, np.cumsum(counts)) * 100 / rate)  # hundredths of a second
    octree = Image.Quantize.FASTOCTREE  # keeps the colors of small things, which a median cut blends with what is near
    first, *others = (Image.fromarray(picture).quantize(method=octree) for picture in pictures)
    durations = (10 * np.diff(ends)).astype(int).tolist()  # ms
    first.save(path, save_all=True, append_images=others, duration=durations, loop=0)


def _write_mp4(path: Path, pictures: Iterator[NDArray[np.uint8]], counts: NDArray[np.int64], rate: float) -> None:
    first = next(pictures)
    writer = _video_writer(path, rate, first.shape)
    try:
        for picture, count in zip(itertools.chain([first], pictures), counts, strict=True):
            for _ in range(count):
                writer.write(cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    finally:
        writer.release()


def _video_writer(path: Path, rate: float, shape: tuple[int, ...]) -> cv2.VideoWriter:
    for codec in _CODECS:
        writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*codec), rate, shape[1::-1])
        if writer.isOpened():
            return writer
    raise GvpError(f"this OpenCV writes no .mp4, neither as {' nor as '.join(_CODECS)}; .gif and .html need no codec")


FILMS = {".mp4": _write_mp4, ".gif": _write_gif}
"""Writers of films, by the file's ending."""
