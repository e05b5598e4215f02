"""What the library exports: the public names of each room, and their public methods; and what its pictures keep to."""

from __future__ import annotations

import functools
import inspect
import pkgutil
from collections.abc import Iterator
from enum import Enum
from importlib import import_module
from types import ModuleType
from typing import Any

import cv2
import numpy as np

import gvp_lib

COMMANDS = {"__main__", "cli", "doctor"}
ROOMS = [room.name for room in pkgutil.iter_modules(gvp_lib.__path__) if room.name not in COMMANDS]


def names_of(room: str) -> dict[str, Any]:
    """What a room offers, by name: its ``__all__``, or else those of its modules."""
    module = import_module(f"gvp_lib.{room}")
    modules = [module]
    if not hasattr(module, "__all__"):
        inside = pkgutil.iter_modules(getattr(module, "__path__", ()), f"{module.__name__}.")
        modules += [import_module(each.name) for each in inside]
    return {name: getattr(each, name) for each in modules for name in getattr(each, "__all__", defined_in(each))}


def exported(room: str) -> dict[str, Any]:
    """Public classes and functions of a room, by name."""
    return {
        name: value for name, value in names_of(room).items() if inspect.isclass(value) or inspect.isfunction(value)
    }


def defined_in(module: ModuleType) -> list[str]:
    """Names without an underscore that a module defines, and does not only import."""
    return [
        name
        for name, value in vars(module).items()
        if not name.startswith("_") and getattr(value, "__module__", "") == module.__name__
    ]


def methods_of(cls: type) -> Iterator[tuple[str, Any]]:
    """Public methods and properties of a class, also those of its bases in the library, unwrapped."""
    found: dict[str, Any] = {}
    for base in cls.__mro__:
        if base.__module__.startswith("gvp_lib"):
            found = {**vars(base), **found}
    for name, value in found.items():
        if isinstance(value, classmethod | staticmethod):
            value = value.__func__
        elif isinstance(value, functools.cached_property):
            value = value.func
        written_here = str(getattr(value, "__module__", "")).startswith("gvp_lib")  # not by matplotlib
        if not name.startswith("_") and (isinstance(value, property) or (inspect.isfunction(value) and written_here)):
            yield name, value


def is_kind_of_type(value: Any) -> bool:
    """Whether ``value`` is a protocol, an enum or an exception, of which nobody makes instances as of other classes."""
    if not inspect.isclass(value):
        return False
    return getattr(value, "_is_protocol", False) or issubclass(value, Enum | BaseException)


def check_picture(png: bytes) -> None:
    """Assert that a picture fits a page, is light, not blank, and not cut off at its border."""
    pixels = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_GRAYSCALE)
    height, width = pixels.shape
    assert 300 <= width <= 1000
    assert 150 <= height <= 1000
    assert len(png) < 500_000, len(png)  # of a noisy camera: noise does not compress
    assert np.ptp(pixels) > 100
    border = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
    assert (border > 200).all(), "something is cut off at the figure's border"
