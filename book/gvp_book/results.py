"""Stored results: numbers beside what made them, so that a page can say how.

A result is a JSON file with its command, its seeds, the versions of what computed it, the commit, the machine, and what
a test runs again of it, which tells whether it still holds. It has no date, host or path: the same run on the same
machine writes the same bytes.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import platform
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import gvp_lib
from gvp_lib.errors import InvalidParameterError, ResultError
from gvp_lib.jobs import source_commit, write_file

__all__ = ["read_result", "rounded", "write_result"]

_FIELDS = ("name", "command", "seeds", "versions", "commit", "hardware", "replayed", "content")


def write_result(
    path: Path | str, *, name: str, command: str, seeds: int | Sequence[int], replayed: str, content: Any
) -> None:
    """Store a result whole or not at all: a reader never finds half a file.

    Parameters
    ----------
    path
        The file; its folder is made if need be.
    name
        What it is, for whoever opens the file.
    command
        What to type to compute it again.
    seeds
        Every seed that it depends on.
    replayed
        What is run again, to see whether it still holds.
    content
        The numbers: JSON data, in which dataclasses, arrays and NumPy's numbers may stand too. What is not finite
        becomes null, as JSON has no other word for it. See :func:`rounded`.
    """
    result = {
        "name": name,
        "command": command,
        "seeds": [int(seed) for seed in np.atleast_1d(seeds)],
        "versions": {
            "python": platform.python_version(),
            "gvp_lib": gvp_lib.__version__,
            "opencv": cv2.__version__,  # installed under one of several names
            **{package: metadata.version(package) for package in ("numpy", "scipy", "mujoco", "mink")},
        },
        "commit": source_commit(),
        "hardware": {
            "system": platform.system(),
            "machine": platform.machine(),
            "cores": os.cpu_count(),
            "renderer": None,  # whatever drew the pictures: that the golden episodes know
        },
        "replayed": replayed,
        "content": _plain(content, "content"),
    }
    text = json.dumps(result, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    write_file(path, text.encode())


def read_result(path: Path | str) -> dict[str, Any]:
    """A stored result: ``name``, ``command``, ``seeds``, ``versions``, ``commit``, ``hardware``, ``replayed``,
    ``content``.

    Raises
    ------
    ResultError
        There is no such file, or it is no result.
    """
    path = Path(path)
    try:
        result = json.loads(path.read_text("utf-8"))
    except OSError as error:
        there = ", ".join(sorted(file.name for file in path.parent.glob("*.json"))) or "none"
        raise ResultError(f"no result can be read at {path} ({error.strerror}); results beside it: {there}") from error
    except ValueError as error:
        raise ResultError(
            f"{path} is not JSON ({error}); write_result wrote another file, or compute it anew"
        ) from error
    missing = [field for field in _FIELDS if not isinstance(result, dict) or field not in result]
    if missing:
        raise ResultError(f"{path} is not a result of write_result: it has no {', '.join(missing)}")
    return result


def rounded(data: Any, digits: int) -> Any:
    """JSON data with every float at so many significant digits, 1 or more; what :func:`write_result` takes, it takes.

    Examples
    --------
    >>> rounded({"mean": 12.3456, "n": 1234567, "all": [0.00123456]}, 3)
    {'mean': 12.3, 'n': 1234567, 'all': [0.00123]}
    """
    return _plain(data, "data", digits)


def _plain(data: Any, place: str, digits: int | None = None) -> Any:
    """The same in dictionaries, lists, strings, numbers, booleans and None alone."""
    if dataclasses.is_dataclass(data) and not isinstance(data, type):
        data = {field.name: getattr(data, field.name) for field in dataclasses.fields(data)}
    if isinstance(data, np.ndarray | np.generic):
        data = data.tolist()
    if isinstance(data, Mapping):
        if odd := [key for key in data if not isinstance(key, str)]:
            raise InvalidParameterError(f"names in a result are strings; {place} has {odd[0]!r}. Write str(...)")
        return {key: _plain(value, f"{place}.{key}", digits) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_plain(value, f"{place}[{i}]", digits) for i, value in enumerate(data)]
    if isinstance(data, float):
        number = float(data) if digits is None else float(f"{data:.{digits}g}")
        return number if math.isfinite(number) else None
    if data is None or isinstance(data, str | bool | int):
        return data
    raise InvalidParameterError(
        f"a result holds dictionaries, lists, text, numbers, arrays and dataclasses; {place} is a {type(data).__name__}"
    )
