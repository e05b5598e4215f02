"""The printed label of the tomato soup carton, drawn by code."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["soup_label"]

# RGB. Every ink is between red and cream, so that one wrapping hue range holds the whole label.
_RED = (196, 36, 26)
_TOMATO = (226, 62, 34)
_SHINE = (246, 142, 96)
_CREAM = (244, 214, 158)
_GOLD = (222, 160, 52)
_BROWN = (104, 36, 20)

_SIZE = 256  # px, the side of each face of the cube texture
_ASPECT = 67 / 100  # a side face is drawn undistorted, then stretched into its square


@cache
def soup_label() -> NDArray[np.uint8]:
    """Six square faces one above the other, shape (1536, 256, 3), RGB: +x, -x, +y, -y, +z, -z."""
    front, back, top = _front(), _ingredients(), _lid()
    # Turned as MuJoCo lays a cube texture onto a box, so that the print stands upright on every side.
    faces = [
        np.rot90(front, 1),
        np.rot90(front, -1),
        np.rot90(back, 2),
        back,
        top,
        np.full_like(top, _RED),
    ]
    label = np.ascontiguousarray(np.concatenate(faces))
    label.flags.writeable = False
    return label


def _blank(height: int, width: int, color: tuple[int, int, int]) -> NDArray[np.uint8]:
    return np.full((height, width, 3), color, np.uint8)


def _write(
    image: NDArray[np.uint8], text: str, center: tuple[int, int], height: int, color: tuple[int, int, int]
) -> None:
    """Text centered on ``center``, ``(u, v)``, with capitals ``height`` px tall."""
    font, thickness = cv2.FONT_HERSHEY_DUPLEX, max(1, round(height / 9))
    scale = cv2.getFontScaleFromHeight(font, height, thickness)
    (width, tall), _ = cv2.getTextSize(text, font, scale, thickness)
    origin = (center[0] - width // 2, center[1] + tall // 2)
    cv2.putText(image, text, origin, font, scale, color, thickness, cv2.LINE_AA)


def _squeeze(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A side face drawn at its true proportions, as a square: the carton stretches it back."""
    return cv2.resize(image, (_SIZE, _SIZE), interpolation=cv2.INTER_AREA).astype(np.uint8)


def _tomato(image: NDArray[np.uint8], center: tuple[int, int], radius: int) -> None:
    """A ripe tomato with its calyx. The calyx is brown: green would leave the label's range of hues."""
    u, v = center
    cv2.ellipse(image, center, (round(1.12 * radius), radius), 0, 0, 360, _BROWN, -1, cv2.LINE_AA)
    cv2.ellipse(image, center, (round(1.06 * radius), round(0.94 * radius)), 0, 0, 360, _TOMATO, -1, cv2.LINE_AA)
    shine = (u - round(0.45 * radius), v - round(0.35 * radius))
    cv2.ellipse(image, shine, (round(0.28 * radius), round(0.16 * radius)), -35, 0, 360, _SHINE, -1, cv2.LINE_AA)
    stem = (u, v - round(0.82 * radius))
    for angle in np.radians((200, 250, 290, 340, 30, 150)):
        tip = (round(stem[0] + 0.5 * radius * np.cos(angle)), round(stem[1] + 0.36 * radius * np.sin(angle)))
        cv2.line(image, stem, tip, _BROWN, max(2, radius // 9), cv2.LINE_AA)


def _front() -> NDArray[np.uint8]:
    """The face with the tomato."""
    height, width = round(_SIZE / _ASPECT), _SIZE
    image = _blank(height, width, _CREAM)
    middle = width // 2
    image[: height * 36 // 100] = _RED
    image[height * 36 // 100 : height * 39 // 100] = _GOLD
    _write(image, "TOMATO", (middle, height * 13 // 100), 38, _CREAM)
    _write(image, "SOUP", (middle, height * 27 // 100), 38, _CREAM)
    _tomato(image, (middle, height * 62 // 100), width * 27 // 100)
    for k in range(0, width, 32):  # a striped hem
        image[height * 89 // 100 :, k : k + 16] = _RED
    image[height * 87 // 100 : height * 89 // 100] = _GOLD
    return _squeeze(image)


def _ingredients() -> NDArray[np.uint8]:
    """The face between: stripes and small print."""
    height, width = round(_SIZE / _ASPECT), _SIZE
    image = _blank(height, width, _RED)
    middle = width // 2
    image[height * 22 // 100 : height * 80 // 100, width // 10 : width * 9 // 10] = _CREAM
    _write(image, "TOMATO SOUP", (middle, height * 11 // 100), 20, _CREAM)
    _tomato(image, (middle, height * 34 // 100), width * 11 // 100)
    for row, text in enumerate(("ripe tomatoes", "onion, basil", "a pinch of salt", "serves two")):
        _write(image, text, (middle, height * (50 + 8 * row) // 100), 13, _BROWN)
    _write(image, "450 ml", (middle, height * 90 // 100), 26, _CREAM)
    return _squeeze(image)


def _lid() -> NDArray[np.uint8]:
    """The top: a tomato in a ring, and a fold."""
    image = _blank(_SIZE, _SIZE, _RED)
    middle = _SIZE // 2
    cv2.rectangle(image, (14, 14), (_SIZE - 15, _SIZE - 15), _GOLD, 5)
    cv2.circle(image, (middle, middle), _SIZE * 36 // 100, _CREAM, -1, cv2.LINE_AA)
    _tomato(image, (middle, middle + 6), _SIZE * 22 // 100)
    return image
