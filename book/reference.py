"""The book's own Sphinx extension for the API reference: signatures as the source spells them, and links to others.

Sphinx links to other projects by inventories that it fetches when it builds. The book builds without a network, so the
addresses are worked out from names instead: ``numpy.typing.NDArray`` has its page where NumPy's documentation puts it.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import textwrap
from collections.abc import Iterator
from dataclasses import is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.nodes import Element
from external import external_url
from sphinx.addnodes import pending_xref, pending_xref_condition
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util.nodes import make_refnode

import gvp_book
import gvp_lib

PACKAGES = {package.__name__: Path(package.__file__).parents[1] for package in (gvp_lib, gvp_book)}
"""Folders that the documented packages stand in."""


def _public() -> dict[str, str]:
    """A public name is documented where a user imports it from, the top or a room, whatever module holds it."""
    found = {"gvp_lib.errors.GvpError": "gvp_lib.GvpError"}
    for folder in sorted(path.parent for path in Path(gvp_lib.__file__).parent.glob("*/__init__.py")):
        room = f"gvp_lib.{folder.name}"
        stub = folder / "__init__.pyi"
        homes = _names(stub if stub.exists() else folder / "__init__.py", room)
        for name in importlib.import_module(room).__all__:
            found[homes[name]] = found[f"{room}.{name}"] = f"{'gvp_lib' if name in gvp_lib.__all__ else room}.{name}"
    return found


def _names(source: Path, module: str) -> dict[str, str]:
    """What each name means that a file imports or defines, where it is defined or re-exported."""
    meant: dict[str, str] = {}
    for node in ast.walk(ast.parse(source.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            meant |= {a.asname or a.name.partition(".")[0]: a.name if a.asname else a.name.partition(".")[0]
                      for a in node.names}  # fmt: skip
        elif isinstance(node, ast.ImportFrom):
            meant |= {a.asname or a.name: f"{node.module}.{a.name}" for a in node.names}
        elif isinstance(node, ast.ClassDef | ast.FunctionDef) and node.col_offset == 0:
            meant[node.name] = f"{module}.{node.name}"
        elif isinstance(node, ast.Assign) and node.col_offset == 0 and isinstance(node.targets[0], ast.Name):
            meant[node.targets[0].id] = f"{module}.{node.targets[0].id}"
        elif isinstance(node, ast.AnnAssign) and node.col_offset == 0 and isinstance(node.target, ast.Name):
            meant[node.target.id] = f"{module}.{node.target.id}"
    return meant


PUBLIC = _public()


@cache
def names_in(module: str) -> dict[str, str]:
    """What each name means that a module of the library imports or defines: ``np`` is ``numpy``."""
    path = PACKAGES[module.partition(".")[0]] / Path(*module.split("."))
    source = path.with_suffix(".py") if path.with_suffix(".py").exists() else path / "__init__.py"
    return {short: PUBLIC.get(full, full) for short, full in _names(source, module).items()}


class _InFull(ast.NodeTransformer):
    """Names of a module in full; whoever shows them keeps the last part."""

    def __init__(self, module: str) -> None:
        self.meant = names_in(module)

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return ast.parse(self.meant.get(node.id, node.id), mode="eval").body


def signature_of(obj: Any) -> tuple[str, str] | None:
    """``(arguments, result)`` of a function or class as its source spells them, types in full; None where it has none.

    A default stays the expression that it is, ``np.radians(60)``, and not its value.
    """
    if isinstance(obj, type):
        if issubclass(obj, Enum) or getattr(obj, "_is_protocol", False):
            return "", ""
        if is_dataclass(obj):
            return f"({', '.join(_fields(obj))})", ""
        obj = obj.__dict__.get("__init__")
    obj = inspect.unwrap(getattr(obj, "__func__", obj)) if obj is not None else None
    if not inspect.isfunction(obj) or not obj.__module__.startswith(("gvp_lib", "gvp_book")):
        return None
    node = ast.parse(textwrap.dedent(inspect.getsource(obj))).body[0]
    assert isinstance(node, ast.FunctionDef)
    full = _InFull(obj.__module__)
    for argument in [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]:
        argument.annotation = argument.annotation and full.visit(argument.annotation)
    if node.args.args and node.args.args[0].arg in ("self", "cls"):
        del node.args.args[0]
    result = ast.unparse(full.visit(node.returns)) if node.returns is not None and node.name != "__init__" else ""
    return f"({ast.unparse(node.args)})", result


def _fields(cls: type) -> Iterator[str]:
    """The fields of a dataclass as arguments."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(cls))).body[0]
    assert isinstance(tree, ast.ClassDef)
    if any("kw_only=True" in ast.unparse(decorator) for decorator in tree.decorator_list):
        yield "*"
    full = _InFull(cls.__module__)
    for node in tree.body:
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            default = _default(node.value)
            told = f"{node.target.id}: {ast.unparse(full.visit(node.annotation))}"
            yield told + (f" = {default}" if default else "")


def _default(value: ast.expr | None) -> str:
    """A field's default in the words of its source."""
    if isinstance(value, ast.Call) and ast.unparse(value.func) == "field":
        given = {keyword.arg: ast.unparse(keyword.value) for keyword in value.keywords}
        if "default_factory" not in given:
            return given.get("default", "")
        made = given["default_factory"]
        return made.removeprefix("lambda: ") if made.startswith("lambda") else f"{made}()"
    return ast.unparse(value) if value is not None else ""


def process_signature(
    app: Sphinx, what: str, name: str, obj: Any, options: Any, args: str | None, result: str | None
) -> tuple[str, str] | None:
    """For autodoc."""
    return signature_of(obj) if what in {"class", "exception", "function", "method"} else None


def process_docstring(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """What the library's docstrings mean, in the form in which napoleon understands it."""
    # Fields that share a line of description, "fx, fy", are one name to Sphinx where no blank parts them.
    if "Attributes" in lines:
        for k in range(lines.index("Attributes"), len(lines)):
            if re.fullmatch(r"\w+(, \w+)+", lines[k]):
                lines[k] = lines[k].replace(", ", ",")
    # A result that is told in prose, without a line for its type.
    start = next((k + 2 for k, line in enumerate(lines[:-2]) if line == "Returns" and lines[k + 1][:2] == "--"), None)
    if start is None:
        return
    end = next((k for k in range(start, len(lines)) if not lines[k]), len(lines))
    if not any(line.startswith(" ") for line in lines[start:end]):
        lines[start:end] = [":", *("    " + line for line in lines[start:end])]


def mend_property(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Of a property, napoleon takes what stands before a colon for its type; here it is the sentence's first half."""
    kind = next((k for k, line in enumerate(lines) if line.startswith(":type: ")), None)
    if what == "property" and kind is not None:
        lines[0] = f"{lines[kind].removeprefix(':type: ')}: {lines[0].strip()}"
        del lines[kind]


@cache
def _meanings() -> dict[str, str]:
    """Short names as docstrings use them; a public name is meant before any other."""
    meant: dict[str, str] = {}
    for package, folder in PACKAGES.items():
        for path in sorted((folder / package).rglob("*.py")):
            module = ".".join(path.relative_to(folder).with_suffix("").parts).removesuffix(".__init__")
            for short, full in names_in(module).items():
                if full.startswith(f"{package}.") or short not in meant:
                    meant[short] = full
    return meant | {public.rpartition(".")[2]: public for public in PUBLIC.values()}


def in_full(target: str) -> str:
    """The name that a reference means: ``Blob.ratio`` is ``gvp_lib.Blob.ratio``."""
    parts = target.split(".")
    for cut in range(len(parts), 1, -1):  # the longest first: a room may offer a function of its module's name
        if public := PUBLIC.get(".".join(parts[:cut])):
            return ".".join([public, *parts[cut:]])
    first, dot, rest = target.partition(".")
    return _meanings().get(first, first) + dot + rest


def resolve(app: Sphinx, env: BuildEnvironment, node: pending_xref, shown: Element) -> Element | None:
    """A reference that Sphinx does not find: a name of the library spelled otherwise, or a name of others."""
    if node.get("refdomain") != "py":
        return None
    for condition in node.children:
        if isinstance(condition, pending_xref_condition) and condition.get("condition") == "resolved":
            shown = nodes.inline("", "", *condition.children)
    target, objects = in_full(node["reftarget"]), env.get_domain("py").objects  # type: ignore[attr-defined]
    if target.startswith(("gvp_lib.", "gvp_book.")):
        # An attribute that a class describes, rather than lists, is found at the class.
        for name in (target, target.rpartition(".")[0]):
            if name in objects and _exists(target):
                entry = objects[name]
                here = node.get("refdoc", env.docname)
                return make_refnode(app.builder, here, entry.docname, entry.node_id, shown, target)
        return shown if _exists(target) else None
    url = external_url(target)
    return nodes.reference("", "", shown, internal=False, refuri=url, reftitle=target) if url else None


def _exists(name: str) -> bool:
    """Whether a dotted name means something in one of the packages."""
    parts = name.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found: Any = importlib.import_module(".".join(parts[:cut]))
        except ImportError:
            continue
        for k, part in enumerate(parts[cut:], cut):
            if isinstance(found, type) and re.search(rf"^\s*(\w+, )*{part}\b", inspect.getdoc(found) or "", re.M):
                return k == len(parts) - 1
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.setup_extension("sphinx.ext.autodoc")
    app.setup_extension("sphinx.ext.napoleon")
    app.config.autodoc_typehints = "none"  # signature_of has them, and properties say in words what they are
    app.config.autodoc_member_order = "bysource"
    app.config.autodoc_default_options = {"members": True}
    app.config.napoleon_google_docstring = False
    app.config.napoleon_use_ivar = True
    app.config.python_use_unqualified_type_names = True
    app.config.python_maximum_signature_line_length = 70
    app.connect("autodoc-process-signature", process_signature)
    app.connect("autodoc-process-docstring", process_docstring, priority=400)  # before napoleon
    app.connect("autodoc-process-docstring", mend_property, priority=600)  # after it
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
