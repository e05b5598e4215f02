"""The code of a page of prose, as a reader would try it: block by block, from top to bottom, in an empty folder.

A block whose first line is a comment with a file's name (``# mug.py``, ``<!-- mug.xml -->``) is saved under that name;
any other block of Python runs; a ``gvp`` command in a block of Bash runs; and a block of text that follows is what
they are to print. A ``{code-block}`` is not run, and says so in its caption.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
_FENCE = re.compile(r"^```(python|xml|bash|text)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_SHOWN = re.compile(r"^```\{code-block\} (\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_NAME = re.compile(r"\A(?:# |<!-- )([\w.]+\.(?:py|xml))(?: -->)?\n")
_NUMBER = re.compile(r"[-+]?\d+\.?\d*")


@dataclass(frozen=True)
class Block:
    """A block of code: its language, its text, and where it stands."""

    language: str
    text: str
    line: int

    @property
    def code(self) -> str:
        """The text without the options of a block that is only shown."""
        return re.sub(r"\A(:\w+:.*\n)+", "", self.text)


def blocks(page: Path, shown: bool = False) -> list[Block]:
    """All blocks of a page that count, or all that are only ``shown``."""
    text = page.read_text("utf-8")
    found = (_SHOWN if shown else _FENCE).finditer(text)
    return [Block(m[1], m[2], text.count("\n", 0, m.start()) + 2) for m in found]


def run_page(page: Path, folder: Path) -> None:
    """Run a page's blocks in a folder; an assertion fails where one prints something else than the page says."""
    session: dict[str, Any] = {"__name__": "__main__"}
    printed, printer, known = "", 0, set(sys.modules)
    with contextlib.chdir(folder):
        sys.path.insert(0, str(folder))
        try:
            for block in blocks(page):
                where = f"{page.name}, line {block.line}"
                if block.language == "text":
                    assert printer, f"{where}: nothing ran before this text"
                    assert alike(printed, block.text), f"{where}: line {printer} printed\n{printed}\nnot\n{block.text}"
                    printed, printer = "", 0
                elif named := _NAME.match(block.text):
                    (folder / named[1]).write_text(block.text, "utf-8")
                elif block.language == "python":
                    source = "\n" * (block.line - 1) + block.text  # so that a traceback shows the page's line
                    with contextlib.redirect_stdout(io.StringIO()) as out:
                        exec(compile(source, str(page), "exec"), session)
                    printed, printer = out.getvalue(), block.line
                elif block.language == "bash":
                    printed, printer = _command(block.text, where), block.line
        finally:  # what was imported from the folder is forgotten
            sys.path.remove(str(folder))
            for name in set(sys.modules) - known:
                if str(getattr(sys.modules[name], "__file__", "")).startswith(str(folder)):
                    del sys.modules[name]


def alike(printed: str, expected: str, share: float = 0.1, steps: int = 2) -> bool:
    """Whether two texts agree: every word, and every number within this share or so many units of its last digit."""
    if _NUMBER.sub("#", printed).split() != _NUMBER.sub("#", expected).split():
        return False
    for a, b in zip(_NUMBER.findall(printed), _NUMBER.findall(expected), strict=True):
        unit = 10.0 ** -len(b.partition(".")[2])
        if abs(float(a) - float(b)) > max(share * abs(float(b)), steps * unit) + 1e-12:
            return False
    return True


def run_python(*arguments: str | Path, folder: Path | None = None, **settings: str) -> subprocess.CompletedProcess[str]:
    """Run a Python that knows this checkout, in a ``folder``, with ``settings`` in its environment."""
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = os.environ | settings | {"PYTHONPATH": path}
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, cwd=folder, env=environment)


def _command(text: str, where: str) -> str:
    """What the ``gvp`` commands of a block print."""
    out = ""
    for words in (shlex.split(line, comments=True) for line in text.replace("\\\n", " ").splitlines()):
        if words:
            assert words[0] == "gvp", f"{where}: only gvp commands are run here, not {words}"
            ran = run_python("-m", "gvp_lib", *words[1:])
            assert ran.returncode == 0, f"{where}: {words}\n{ran.stderr}"
            out += ran.stdout
    return out
