"""The code that a result depends on: the modules that computed it and all that they import, read but never run."""

from __future__ import annotations

import ast
import hashlib
import io
import tokenize
from collections.abc import Iterable, Iterator, Sequence
from difflib import get_close_matches
from functools import lru_cache
from importlib.util import resolve_name
from pathlib import Path

from gvp_lib.errors import InvalidParameterError

__all__ = ["code_hash"]

_LIBRARY = "gvp_lib"
_ROOT = Path(__file__).resolve().parent.parent
_NO_NUMBERS = (f"{_LIBRARY}.errors",)  # names and texts of errors: they decide no result
_ROOMS_WITH_DATA = ("simulation",)  # what reads files that are no modules: the models


def code_hash(modules: str | Sequence[str]) -> str:
    """SHA-256, as hex digits, of all code of this library that some of its modules run.

    That is their source files, those of every module of this library that they import, directly or not, at their top
    or in a function, and the ``__init__.py`` of each room on the way. Where a module of ``simulation`` is among them,
    so are its models. Each file counts with its place.

    Not counted are comments, docstrings and empty lines; imports for type checkers alone and ``errors``, which change
    no number; ``gvp_lib/__init__.py``,
    which names everything and computes nothing; and other packages, whose versions stand in a result by themselves.
    Not seen are a module that is imported by a name made at run time, and ``gvp_lib.name`` after ``import gvp_lib``;
    no module that computes does either.

    Parameters
    ----------
    modules
        Full names, of one or several.

    Raises
    ------
    InvalidParameterError
        None is given, or one is no module of this library.

    Examples
    --------
    >>> len(code_hash("gvp_lib.experiments.statistics"))
    64
    """
    closure = _closure([modules] if isinstance(modules, str) else list(modules))
    rooms = {module.split(".")[1] for module in closure}
    files = set(closure.values()).union(*(_data(room) for room in _ROOMS_WITH_DATA if room in rooms))
    digest = hashlib.sha256()
    for place, file in sorted((file.relative_to(_ROOT).as_posix(), file) for file in files):
        data = _what_runs(file.read_bytes()) if file.suffix == ".py" else file.read_bytes()
        if data or file.name != "__init__.py":  # an empty one only says that a folder is a package
            digest.update(f"{place}\n{len(data)}\n".encode() + data)
    return digest.hexdigest()


def _what_runs(source: bytes) -> bytes:
    """A module's source without comments, docstrings and empty lines.

    Cut out of the text rather than written anew from its tree, which no two versions of Python write alike.
    """
    lines = source.splitlines(keepends=True)
    spans = [
        ((text.lineno, text.col_offset), (text.end_lineno or text.lineno, text.end_col_offset or 0))
        for node in ast.walk(ast.parse(source))
        if isinstance(body := getattr(node, "body", None), list)
        for text in body
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant) and isinstance(text.value.value, str)
    ]
    for token in tokenize.tokenize(io.BytesIO(source).readline):
        if token.type == tokenize.COMMENT:
            row, column = token.start
            start = len(token.line[:column].encode())  # the tree counts bytes, tokens count characters
            spans.append(((row, start), (row, start + len(token.string.encode()))))
    for (first, start), (last, end) in sorted(spans, reverse=True):
        lines[first - 1 : last] = [lines[first - 1][:start] + lines[last - 1][end:], *[b""] * (last - first)]
    return b"\n".join(line.rstrip() for line in lines if line.strip())


def _closure(modules: Sequence[str]) -> dict[str, Path]:
    """The files of these modules and of what they import, by full name."""
    if not modules:
        raise InvalidParameterError("a result depends on one module or more; got none")
    for module in modules:
        if _file(module) is None:
            raise InvalidParameterError(_unknown(module))
    public = _public_names()
    found: dict[str, Path] = {}
    waiting = list(modules)
    while waiting:
        module = waiting.pop()
        file = _file(module)
        if file is None:  # a name inside a module, a public name of the library, or not ours at all
            waiting += [public[module]] if module in public else []
        elif module not in found and module not in _NO_NUMBERS:
            found[module] = file
            # The rooms on the way to a module are run before it.
            waiting += (module.rsplit(".", k)[0] for k in range(1, module.count(".")))
            package = module if file.name == "__init__.py" else module.rpartition(".")[0]
            waiting += _imported(file.read_bytes(), package)
    return found


def _file(module: str) -> Path | None:
    """Where a module or a room of this library is written; None for its top and for all that is neither."""
    library, *parts = module.split(".")
    if library != _LIBRARY or not parts:
        return None
    place = _ROOT.joinpath(*parts)
    files = (place / "__init__.py", place.with_name(f"{place.name}.py"))
    return next((file for file in files if file.is_file()), None)


def _data(room: str) -> Iterator[Path]:
    for file in (_ROOT / room).rglob("*"):
        if file.is_file() and file.suffix != ".py" and "__pycache__" not in file.parts:
            yield file


@lru_cache(maxsize=1024)  # the closures of several results share most of their files
def _imported(source: bytes, package: str) -> tuple[str, ...]:
    """Full names of what a module of a package may import: ``from a import b`` may mean the module ``a.b``."""
    names: list[str] = []
    for statement in _statements([ast.parse(source)]):
        if isinstance(statement, ast.Import):
            names += [alias.name for alias in statement.names]
        else:
            stem = resolve_name("." * statement.level + (statement.module or ""), package)
            names += [stem, *(f"{stem}.{alias.name}" for alias in statement.names)]
    return tuple(names)


def _statements(nodes: Iterable[ast.AST]) -> Iterator[ast.Import | ast.ImportFrom]:
    """Every import that may run, wherever it stands."""
    for node in nodes:
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node
        elif isinstance(node, ast.If) and ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING"):
            yield from _statements(node.orelse)
        else:
            yield from _statements(ast.iter_child_nodes(node))


def _public_names() -> dict[str, str]:
    """The module that each public name comes from: ``gvp_lib.WorkCell`` is of ``gvp_lib.simulation.workcell``."""
    tree = ast.parse((_ROOT / "__init__.py").read_bytes())
    return {
        f"{_LIBRARY}.{alias.asname or alias.name}": node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith(f"{_LIBRARY}.")
        for alias in node.names
    }


def _unknown(module: str) -> str:
    places = (file.relative_to(_ROOT).with_suffix("") for file in _ROOT.rglob("*.py") if file.stem[0] != "_")
    known = sorted(".".join([_LIBRARY, *place.parts]) for place in places)
    near = get_close_matches(module, known, n=3, cutoff=0)
    return f"there is no module {module!r} in {_LIBRARY}, by its full name. Nearest are {', '.join(near)}"
