"""The README's example runs as it stands there, and prints what stands below it."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from snippets import ROOT, blocks

README = ROOT / "README.md"
BLOCKS, (PRINTED, *_) = (
    [block.text for block in blocks(README) if block.language == language] for language in ("python", "text")
)


def test_the_readme_has_one_example_and_it_is_short() -> None:
    assert len(BLOCKS) == 1
    assert len(BLOCKS[0].splitlines()) <= 18


def test_the_readme_example_runs(tmp_path: Path) -> None:
    program = tmp_path / "example.py"
    program.write_text(BLOCKS[0], encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(README.parent)}
    result = subprocess.run([sys.executable, program], capture_output=True, text=True, cwd=tmp_path, env=environment)
    assert result.returncode == 0, result.stderr
    printed, told = (re.findall(r"[\d.]+|[^\d.]+", text) for text in (result.stdout, PRINTED))
    assert len(printed) == len(told), result.stdout
    for ours, theirs in zip(printed, told, strict=True):  # a pixel more or less on another machine
        assert ours == theirs or float(ours) == pytest.approx(float(theirs), rel=0.01), result.stdout


def test_the_files_that_the_readme_names_exist() -> None:
    linked = re.findall(r"\]\(([^)#:]+)\)", README.read_text("utf-8"))
    assert linked
    missing = [name for name in linked if not (README.parent / name).exists()]
    assert missing == []
