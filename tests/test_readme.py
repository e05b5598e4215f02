"""The README's one example is short, runs as it stands there, and prints what stands below it."""

from pathlib import Path

from snippets import ROOT, alike, blocks, run_python


def test_the_readme_example_runs(tmp_path: Path) -> None:
    kinds = ("python", "text")
    (example,), (expected, *_) = ([b.text for b in blocks(ROOT / "README.md") if b.language == kind] for kind in kinds)
    assert len(example.splitlines()) <= 18
    result = run_python("-c", example, folder=tmp_path)
    assert result.returncode == 0, result.stderr
    assert alike(result.stdout, expected, share=0.01, steps=0), result.stdout  # a pixel more or less on another machine
