"""Models of arms and objects from anywhere: an MJCF or URDF file, or the XML itself, as a spec keeps and loads it."""

from __future__ import annotations

import codecs
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from reprlib import Repr

import mujoco

from gvp_lib.errors import InvalidParameterError, ModelError

__all__ = ["absolute_meshes", "read_model", "resolved", "text_of"]

_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_SHORT = Repr()
_SHORT.maxstring, _SHORT.maxother = 200, 80  # characters of what was given in a message


class _Xml(str):
    """XML of a model, with the folder from which the files that it names are read."""

    folder: str


def resolved(mjcf: str | os.PathLike[str], owner: str, folder: str | None = None) -> str | Path:
    """Model for a spec to keep: its XML, or the absolute path of its file.

    Either finds its files again, and the same ones, from wherever the process has gone by then.

    Parameters
    ----------
    mjcf
        Path, in which ``~`` is the home folder, or XML, which is whatever has a ``<`` in it.
    owner
        Whose model it is, for messages: ``"arm 'ur5e'"``.
    folder
        Folder that relative paths start from; None for the current one.

    Raises
    ------
    InvalidParameterError
        It is neither.
    """
    if isinstance(mjcf, _Xml):
        return mjcf
    if not isinstance(mjcf, str | os.PathLike):
        hint = "; of an MjSpec, give its to_xml()" if isinstance(mjcf, mujoco.MjSpec) else ""
        raise InvalidParameterError(
            f"{owner}: mjcf is the path of an MJCF or URDF file, or the XML as a string; got {_SHORT.repr(mjcf)}{hint}"
        )
    if folder is None:
        with suppress(FileNotFoundError):  # the current folder has been deleted
            folder = os.getcwd()
    if isinstance(mjcf, str) and "<" in mjcf:
        xml = _Xml(mjcf)
        xml.folder = folder or ""
        return xml
    return Path(folder or "", os.path.expanduser(mjcf))


def read_model(mjcf: str | Path, owner: str) -> mujoco.MjSpec:
    """Read a model as :func:`resolved` gives it; each of its bodies stays one.

    Parameters
    ----------
    mjcf
        XML or absolute path.
    owner
        Whose model it is, for messages.

    Raises
    ------
    ModelError
        There is no such file, or MuJoCo cannot read what is in it.
    """
    with _explained(mjcf, owner):
        model = _parsed(mjcf)
    model.compiler.fusestatic = False  # it would make what stands still a part of its parent, and take its name away
    return model


def text_of(mjcf: str | Path, owner: str) -> str:
    """Text of a model, as it stands; parameters and errors are those of :func:`read_model`."""
    with _explained(mjcf, owner):
        return mjcf if isinstance(mjcf, str) else mjcf.read_text(errors="replace")


def absolute_meshes(model: mujoco.MjSpec) -> None:
    """Name a model's mesh files so that its XML finds them from anywhere.

    Parameters
    ----------
    model
        Model to change.
    """
    folder = Path(model.modelfiledir or ".") / (model.meshdir or "")
    for mesh in model.meshes:
        if mesh.file:
            mesh.file = str((folder / mesh.file).resolve())


@contextmanager
def _explained(mjcf: str | Path, owner: str) -> Iterator[None]:
    """Context in which a model is read: a ModelError says whose it is and what is wrong."""
    problem = f"the MJCF of {owner} cannot be read: "
    if isinstance(mjcf, Path) and not os.path.isfile(mjcf):
        path = _SHORT.repr(str(mjcf))
        what = f"{path} is a folder" if os.path.isdir(mjcf) else f"there is no file {path}"
        raise ModelError(f"{problem}{what}; mjcf is the path of an MJCF or URDF file, or the XML itself")
    try:
        yield
    except (ValueError, OSError) as error:
        raise ModelError(f"{problem}{error}") from error


def _parsed(mjcf: str | Path) -> mujoco.MjSpec:
    if isinstance(mjcf, Path):
        data, name = mjcf.read_bytes(), str(mjcf)
        if data.startswith(_UTF_16):
            data = data.decode("utf-16").encode()
        if not data.removeprefix(codecs.BOM_UTF8).lstrip().startswith(b"<"):
            return mujoco.MjSpec.from_file(name)  # some other format, of which MuJoCo may know
        if not name.endswith((".xml", ".urdf")):  # by which MuJoCo knows that it is XML
            name += ".xml"
    else:  # as if it were a file of its folder: so MuJoCo finds what it includes
        data, name = mjcf.encode(), os.path.join(getattr(mjcf, "folder", ""), ".gvp_lib.xml")
    return mujoco.MjSpec.from_file(name, include={name: data})
