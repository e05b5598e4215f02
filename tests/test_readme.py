"""The README is short, and its one example is, runs as it stands there, and prints what stands below it."""

import re
from pathlib import Path

from snippets import ROOT, alike, blocks, run_python

SECONDS = re.compile(r"\d+\.\d s$", re.MULTILINE)


def test_the_readme_example_runs_and_prints_all_but_the_time(tmp_path: Path) -> None:
    kinds = ("python", "text")
    readme = (ROOT / "README.md").read_text("utf-8").splitlines()
    assert len(readme) <= 120
    assert readme.index("```python") < 40
    (example,), (expected, *_) = ([b.text for b in blocks(ROOT / "README.md") if b.language == kind] for kind in kinds)
    assert len(example.splitlines()) <= 6
    result = run_python("-c", example, folder=tmp_path)
    assert result.returncode == 0, result.stderr
    printed, expected = (SECONDS.sub("- s", text) for text in (result.stdout, expected))
    assert printed.endswith("- s\n")
    assert alike(printed, expected, share=0.02, steps=1), result.stdout  # another machine may take a picture more
