"""The README's one example is short, runs as it stands there, and prints what stands below it."""

import re
from pathlib import Path

import pytest
from snippets import ROOT, blocks, run_python


def test_the_readme_example_runs(tmp_path: Path) -> None:
    kinds = ("python", "text")
    (example,), (expected, *_) = ([b.text for b in blocks(ROOT / "README.md") if b.language == kind] for kind in kinds)
    assert len(example.splitlines()) <= 18
    result = run_python("-c", example, folder=tmp_path)
    assert result.returncode == 0, result.stderr
    printed, told = (re.findall(r"[\d.]+|[^\d.]+", text) for text in (result.stdout, expected))
    for ours, theirs in zip(printed, told, strict=True):  # a pixel more or less on another machine
        assert ours == theirs or float(ours) == pytest.approx(float(theirs), rel=0.01), result.stdout
