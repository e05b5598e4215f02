"""The book's own Sphinx extension: brings the chapters and their 3D scenes into the build.

Chapters are the notebooks of ``notebooks/``, or, with ``outputs = "_build/notebooks"``, the copies that execute.py has
run. Sphinx can read them only from below ``book/``, so at the start of a build each is copied to ``book/notebooks/``; a
3D scene stored in an output becomes a page of its own in ``_static/generated/scenes/``, and the output an ``<iframe>``
on it; the directive ``scene`` shows one elsewhere. With ``solutions = "hide"`` in conf.py, or ``GVP_SOLUTIONS=hide`` in
the environment, the copies lack the solutions of the exercises. meshcat's script and MathJax are copied once, from the
installed packages. What is copied is generated: git ignores it.
"""

from __future__ import annotations

import base64
import gzip
import html
import importlib.metadata
import itertools
import json
import re
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from skeleton import source, without_solutions
from sphinx.application import Sphinx
from sphinx.builders import Builder
from sphinx.config import Config
from sphinx.errors import ConfigError
from sphinx.util.docutils import SphinxDirective

from gvp_lib.errors import DownloadError, MissingExtraError
from gvp_lib.views.lab import lab_scripts, write_lab
from gvp_lib.views.page import LAB_MIME, SCENE_MIME, meshcat_script, write_page

BOOK = Path(__file__).parent
NOTEBOOKS = BOOK.parent / "notebooks"
GENERATED = BOOK / "_static" / "generated"
SCENE = """<div class="gvp-scene" style="height:{height}px;background-image:url({path}/{name}.png)">
<iframe src="{path}/{name}.html" title="{title}" loading="lazy" allowfullscreen></iframe>
<noscript><img src="{path}/{name}.png" alt="{title}"></noscript>
</div>"""
LAB = """<div class="gvp-lab" data-page="{path}/{name}.html" data-height="{height}">
<img src="{path}/{name}.png" alt="{title}">
{door}
</div>"""
DOOR = '<button type="button">Start the laboratory</button>'
NO_DOOR = "<p>The laboratory could not be built into this copy of the book: {why}</p>"
SHOWN = re.compile(r'<div class="gvp-scene".+?scenes/([\w-]+)\.html" title="([^"]*)".+?</div>', re.DOTALL)
PRINTED = r"""<figure class="gvp-still"><img src="_static/generated/scenes/\1.png" alt="\2">
<figcaption>\2. In the book's pages this is a scene that moves and turns.</figcaption></figure>"""


def write_if_changed(path: Path, content: bytes) -> None:
    """Leave an unchanged file alone, so that Sphinx rebuilds only what changed."""
    if not path.exists() or path.read_bytes() != content:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def copy_chapters(app: Sphinx) -> None:
    """Copy notebooks into the source tree, and write the page of every scene in them."""
    kept: set[Path] = set()
    for path in sorted(Path(app.confdir, app.config.outputs).resolve().glob("*.ipynb")):
        notebook = json.loads(path.read_text(encoding="utf-8"))
        notebook["metadata"].pop("gvp", None)  # what execute.py goes by
        if app.config.solutions == "hide":
            notebook = without_solutions(notebook)
        for cell in notebook["cells"]:
            if cell["cell_type"] == "markdown":
                cell["source"] = as_in_the_book(source(cell))
        shown = [output.get("data", {}) for cell in notebook["cells"] for output in cell.get("outputs", ())]
        for number, data in enumerate((data for data in shown if SCENE_MIME in data), 1):
            kept |= place_scene(f"{path.stem}-{number}", data, app.builder)
        for number, data in enumerate((data for data in shown if LAB_MIME in data), 1):
            kept |= place_lab(f"{path.stem}-{number}", data, app.builder)
        target = BOOK / "notebooks" / path.name
        write_if_changed(target, json.dumps(notebook, ensure_ascii=False, indent=1).encode())
        kept.add(target)
    made = (BOOK / "notebooks").glob("*.ipynb"), GENERATED.glob("scenes/*"), GENERATED.glob("labs/*")
    for stale in {*itertools.chain(*made)} - kept:
        stale.unlink()


def as_in_the_book(text: str) -> str:
    """Turn links that hold in a clone into what holds in the book, where chapters lie below ``book/``."""
    text = re.sub(r"\[(`[^`]+`)\]\(\.\./(?:book/)?gvp_\w+/(\w+)[/.][^)]+\)", library_link, text)
    return re.sub(r"\]\(\.\./book/", "](../", text)


def library_link(link: re.Match[str]) -> str:
    """The book has no copy of the library's files: a file's name leads to the API page of its room, if there is one."""
    name, room = link.groups()
    return f"[{name}](../api/{room}.md)" if (BOOK / "api" / f"{room}.md").exists() else name


def check_solutions(app: Sphinx, config: Config) -> None:
    """A misspelled setting must not hand the solutions out."""
    if config.solutions not in ("show", "hide"):
        raise ConfigError(f'solutions (or GVP_SOLUTIONS) is "show" or "hide"; got {config.solutions!r}')


def place_scene(name: str, data: dict[str, Any], builder: Builder) -> set[Path]:
    """Write one scene's page and still, and turn the output's ``data`` into what Sphinx shows. Returns the files."""
    scene, still = data.pop(SCENE_MIME), data.get("image/png", "")
    data.pop("text/html", None)  # a running Jupyter's
    if builder.format != "html":
        return set()
    payload = json.loads(gzip.decompress(base64.b64decode(scene["scene"])))
    page, picture = GENERATED / "scenes" / f"{name}.html", GENERATED / "scenes" / f"{name}.png"
    write_if_changed(page, write_page(payload, scene["title"], "../meshcat.min.js").encode())
    write_if_changed(picture, base64.b64decode(still))
    data.pop("image/png", None)
    data["text/html"] = scene_html(name, scene["title"], int(scene["height"]), "notebooks/")
    return {page, picture}


def place_lab(name: str, data: dict[str, Any], builder: Builder) -> set[Path]:
    """Write a laboratory's page and still, and turn the output's ``data`` into a still with a button that starts it.

    Where MuJoCo for the page is not to be had, the still stands alone, and says so. Returns the files.
    """
    laboratory = data.pop(LAB_MIME)
    data.pop("text/html", None)
    if builder.format != "html":
        return set()
    page, picture = GENERATED / "labs" / f"{name}.html", GENERATED / "labs" / f"{name}.png"
    write_if_changed(picture, base64.b64decode(data.pop("image/png")))
    payload = json.loads(gzip.decompress(base64.b64decode(laboratory["scene"])))
    write_if_changed(page, write_lab(payload, "..").encode())
    why = copy_lab_scripts()
    door = NO_DOOR.format(why=html.escape(why)) if why else DOOR
    title, height = html.escape(laboratory["title"], quote=True), int(laboratory["height"])
    path = "../_static/generated/labs"
    data["text/html"] = LAB.format(path=path, name=name, title=title, height=height, door=door)
    return {page, picture}


@cache
def copy_lab_scripts() -> str:
    """Copy what all laboratories share, once; why not, where that is not to be had."""
    try:
        scripts = lab_scripts()
    except (DownloadError, MissingExtraError) as error:
        return str(error)
    for name, text in scripts.items():
        write_if_changed(GENERATED / name, text.encode())
    return ""


def scene_html(name: str, title: str, height: int, document: str) -> str:
    """A scene in a page: a lazy frame over its still; ``document`` is the page's name, which says how deep it lies."""
    path = "../" * document.count("/") + "_static/generated/scenes"
    return SCENE.format(path=path, name=name, title=html.escape(title, quote=True), height=height)


class ShowScene(SphinxDirective):
    """``{scene} 02_sphere_traversal-2`` shows the second scene of that chapter on a page that is none."""

    required_arguments = 1
    option_spec: ClassVar = {"height": directives.nonnegative_int}

    def run(self) -> list[nodes.Node]:
        """Called by docutils."""
        page = GENERATED / "scenes" / f"{self.arguments[0]}.html"
        if not page.exists():
            there = ", ".join(sorted(path.stem for path in page.parent.glob("*.html")))
            raise self.error(f"No chapter has the scene {self.arguments[0]!r}. There are: {there}.")
        self.env.note_dependency(page)
        title = re.search(r"<title>(.*?)</title>", page.read_text("utf-8"), re.DOTALL)
        shown = scene_html(page.stem, html.unescape(title[1]), self.options.get("height", 480), self.env.docname)
        return [nodes.raw("", shown, format="html")]


def copy_scripts(app: Sphinx) -> None:
    """Copy meshcat's script and the part of MathJax that the book uses: TeX in, HTML and its fonts out."""
    write_if_changed(GENERATED / "meshcat.min.js", meshcat_script().read_bytes())
    package = importlib.metadata.distribution("sphinx-mathjax-offline")
    for file in package.files or ():
        name = file.as_posix().partition("/static/mathjax/")[2]
        if name == "tex-chtml.js" or name.startswith(("output/chtml/fonts/woff-v2/", "input/tex/extensions/")):
            write_if_changed(GENERATED / "mathjax" / name, Path(str(file.locate())).read_bytes())


def mend_page(app: Sphinx, page: str, template: str, context: dict[str, Any], doctree: Any) -> None:
    """Entries of a bibliography are no list items, and parameters no definitions: a screen reader would miscount.

    What is to be printed (pdf.py) has a still in the place of each scene.
    """
    body = context.get("body", "").replace('<div role="list" class="citation-list">', '<div class="citation-list">')
    body = body.replace("<dl>\n<dd><em class=", '<dl role="presentation">\n<dd><em class=')
    body = body.replace('<dd><em class="sig-param">', '<dd role="presentation"><em class="sig-param">')
    if body:
        context["body"] = SHOWN.sub(PRINTED, body) if app.builder.name == "singlehtml" else body


def forgive_genindex(app: Sphinx, builder: Builder) -> None:
    """One page has no index, which the table of contents names. Set here it counts as no change of the settings."""
    if builder.name == "singlehtml":
        app.config.suppress_warnings = [*app.config.suppress_warnings, "toc.not_readable"]


def know_every_node(app: Sphinx) -> None:
    """An extension that says how one node goes into a single page must not hide what all others say of HTML."""
    handlers = app.registry.translation_handlers
    handlers["singlehtml"] = {**handlers.get("html", {}), **handlers.get("singlehtml", {})}


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_config_value("solutions", "show", "env", types=frozenset({str}))
    app.add_config_value("outputs", "../notebooks", "", types=frozenset({str}))
    app.connect("config-inited", check_solutions)
    app.connect("builder-inited", copy_chapters)
    app.connect("builder-inited", copy_scripts)
    app.connect("builder-inited", know_every_node)
    app.connect("write-started", forgive_genindex)
    app.connect("html-page-context", mend_page)
    app.add_directive("scene", ShowScene)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
