"""A data set of viewpoints on disk: Parquet shards with PNG images and typed columns, and a card that describes them.

The layout is that of Hugging Face's `datasets`: ``load_dataset(folder)`` decodes the images and names the actions. To
every other reader it is plain Parquet.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from gvp_lib.errors import DatasetError, InvalidParameterError, UnknownNameError
from gvp_lib.planning.plan import Action

__all__ = [
    "CARD",
    "COLUMNS",
    "as_folders",
    "as_path",
    "damage",
    "decoded",
    "encoded",
    "read_card",
    "read_columns",
    "shard_bytes",
    "shard_name",
]

CARD = "card.json"

_POSE = "position, m, then quaternion (x, y, z, w)"
_F32 = pa.float32()
# Name, type, and what it is.
_TABLE: tuple[tuple[str, pa.DataType, str], ...] = (
    ("image", pa.struct([("bytes", pa.binary()), ("path", pa.string())]), "PNG, RGB: the middle of the picture"),
    ("action", pa.int64(), "best of the five actions: UP, LEFT, DOWN, RIGHT, NO_OP (Eq. 2.10)"),
    ("errors", pa.list_(_F32, 5), "angle to the normal after each action, rad"),
    ("direction", _F32, "where in the image the normal lies, from +u toward +v, rad"),
    ("angle", _F32, "angle to the normal, rad: the viewpoint error"),
    ("roll_error", _F32, "roll that is missing to the major axis, rad; NaN where it is undefined"),
    ("tilt", _F32, "of the viewpoint that was asked for, from the normal, rad"),
    ("azimuth", _F32, "of the same, about the normal, rad"),
    ("roll", _F32, "of the same, about the optical axis, rad"),
    ("world_from_camera", pa.list_(_F32, 7), f"true pose of the optical frame: {_POSE}"),
    ("base_from_camera", pa.list_(_F32, 7), f"the same as the arm believes: {_POSE}"),
    ("world_from_object", pa.list_(_F32, 7), f"true pose of the object: {_POSE}"),
    ("blob_area", pa.int32(), "of the silhouette in the whole picture, px^2"),
    ("blob_centroid", pa.list_(_F32, 2), "u and v in the whole picture, px"),
    ("blob_orientation", _F32, "of the major axis, from +u toward +v, rad; NaN where it is undefined"),
    ("blob_axes", pa.list_(_F32, 2), "major and minor axis length, px"),
    ("overflow", pa.bool_(), "whether the silhouette reaches beyond the image that was kept"),
    ("index", pa.int32(), "number of the sample"),
    ("scene", pa.int32(), "number of the placing of the object"),
    ("attempts", pa.int16(), "viewpoints tried until the arm could take one up; 1: the one that was planned"),
    ("frames", pa.int16(), "pictures taken for this sample"),
    ("seconds", _F32, "simulated time of the arm's motion, s"),
)

COLUMNS: Mapping[str, str] = {name: what for name, _, what in _TABLE}
"""Contents of each column."""


def _feature(name: str, kind: pa.DataType) -> dict[str, Any]:
    """Column as a feature of Hugging Face's `datasets`, for the schema's metadata."""
    if name == "image":
        return {"_type": "Image"}
    if name == "action":
        return {"names": [action.name for action in Action], "_type": "ClassLabel"}
    if pa.types.is_fixed_size_list(kind):
        # Its "List" is the same, but versions before 4 do not know it.
        return {"feature": _feature("", kind.value_type), "length": kind.list_size, "_type": "Sequence"}
    return {"dtype": "float32" if kind == _F32 else str(kind), "_type": "Value"}


_SCHEMA = pa.schema([(name, kind) for name, kind, _ in _TABLE]).with_metadata(
    {"huggingface": json.dumps({"info": {"features": {name: _feature(name, kind) for name, kind, _ in _TABLE}}})}
)


def shard_name(number: int, count: int) -> str:
    """Path of a shard's file in the set's folder."""
    return f"data/train-{number:05d}-of-{count:05d}.parquet"


def shard_bytes(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """Rows as a Parquet file; the same rows give the same bytes."""
    table = pa.Table.from_pylist(list(rows), schema=_SCHEMA)
    sink = io.BytesIO()
    # PNG is compressed already.
    compression = {"image.bytes": "none", "image.path": "none", **dict.fromkeys(COLUMNS, "zstd"), "image": "none"}
    pq.write_table(table, sink, compression=compression, row_group_size=len(rows))
    return sink.getvalue()


def encoded(rgb: NDArray[np.uint8]) -> bytes:
    """An image as PNG."""
    return cv2.imencode(".png", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))[1].tobytes()


def decoded(image: Mapping[str, Any] | bytes) -> NDArray[np.uint8]:
    """Decode the picture in a cell of the column ``image``: RGB uint8 (crop, crop, 3).

    Parameters
    ----------
    image
        Cell as pandas or PyArrow have it, ``{"bytes": ..., "path": ...}``, or its bytes alone.

    Raises
    ------
    DatasetError
        The bytes are no PNG picture.

    Examples
    --------
    >>> decoded({"bytes": encoded(np.zeros((8, 8, 3), np.uint8)), "path": None}).shape
    (8, 8, 3)
    """
    cell = image.as_py() if isinstance(image, pa.Scalar) else image
    data = cell.get("bytes") if isinstance(cell, Mapping) else cell
    bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if isinstance(data, bytes) and data else None
    if bgr is None:
        given = f"{len(data)} bytes" if isinstance(data, bytes) else f"a {type(image).__name__}"
        raise DatasetError(f"{given} are no PNG picture; give a cell of the column 'image'")
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)


def as_path(given: object, what: str, expected: str) -> Path:
    """Absolute path, wherever the process goes meanwhile, of text or of a path; ``~`` is one's home.

    Raises
    ------
    InvalidParameterError
        It is neither.
    """
    if not isinstance(given, str | PathLike):
        raise InvalidParameterError(f"{what} {expected}; got a {type(given).__name__}: {given!r}")
    return Path(given).expanduser().absolute()


def as_folders(given: object) -> list[Path]:
    """Folders of sets of viewpoints, of which one may be given alone."""
    several = given if isinstance(given, Iterable) and not isinstance(given, str | PathLike) else [given]
    return [as_path(each, "a set of viewpoints is", "a folder, given by its path") for each in several]


def read_card(folder: Path | str, *, unfinished: bool = False) -> dict[str, Any]:
    """The card of a set; only with ``unfinished`` may samples be missing.

    Raises
    ------
    DatasetError
        There is no card, or it is none of ours, or the set is not finished.
    """
    path = as_path(folder, "a set of viewpoints is", "a folder, given by its path") / CARD
    advice = "collect_dataset or `gvp collect` collects it, and goes on where it was interrupted"
    try:
        card: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        present, n = card["counts"]["samples"], card["recipe"]["n"]
        _ = dict(card["versions"]), dict(zip(card["shards"].items(), card["counts_of_shards"], strict=True))
    except FileNotFoundError as error:
        raise DatasetError(f"{path} is not there: the set is not finished, or there is none; {advice}") from error
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise DatasetError(f"{path} is no card of a set of viewpoints: {error!r}") from error
    if present < n and not unfinished:
        raise DatasetError(f"the set in {folder} is not finished: it has {present} of {n} samples; {advice}")
    return card


def damage(folder: Path, shards: Mapping[str, str]) -> list[str]:
    """Names of the shards, given with their SHA-256, that are missing or hold something else."""

    def digest(path: Path) -> str:
        try:
            with open(path, "rb") as file:
                return hashlib.file_digest(file, "sha256").hexdigest()
        except OSError:
            return "none"

    return [name for name, expected in shards.items() if digest(folder / name) != expected]


def read_columns(folder: Path | str, columns: Sequence[str] | None = None, *, verify: bool = True) -> pa.Table:
    """A finished set, or some of its :data:`COLUMNS`, as one table in the order of ``index``.

    Raises
    ------
    DatasetError
        The set is unfinished, or, where it is to be verified, a shard is missing or damaged.
    UnknownNameError
        A set has no such column.
    """
    names = list(COLUMNS if columns is None else columns)
    if unknown := [name for name in names if name not in COLUMNS]:
        raise UnknownNameError("column", unknown[0], COLUMNS)
    folder = as_path(folder, "a set of viewpoints is", "a folder, given by its path")
    shards = read_card(folder)["shards"]
    if verify and (broken := damage(folder, shards)):
        raise DatasetError(
            f"{len(broken)} of {len(shards)} shards in {folder} are missing or damaged, the first of them {broken[0]}; "
            "`gvp collect` with the set's own recipe collects them again"
        )
    return pa.concat_tables([pq.read_table(folder / name, columns=names) for name in shards])
