"""Write the chapters as notebooks for students, without their solutions.

    python book/handout.py            # to handout/
    python book/handout.py week_3     # to a folder of your own

The folder stands beside ``notebooks/``, since chapters read ``../book/results``. The self-checks stay: they say why an
answer is wrong. To build the pages of the book without solutions, set ``GVP_SOLUTIONS=hide``.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from skeleton import without_solutions

ROOT = Path(__file__).resolve().parent.parent


def hand_out(folder: Path, notebooks: Path = ROOT / "notebooks") -> list[Path]:
    """Write every chapter without its solutions into a folder; returns the files."""
    if folder.resolve() == notebooks.resolve():
        raise SystemExit(f"{folder} holds the chapters themselves; name another folder, such as handout")
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for chapter in sorted(notebooks.glob("*.ipynb")):
        notebook = without_solutions(json.loads(chapter.read_text(encoding="utf-8")))
        target = folder / chapter.name
        target.write_text(json.dumps(notebook, ensure_ascii=False, indent=1) + "\n", encoding="utf-8")
        written.append(target)
    return written


def main() -> int:
    """Write the handout and say where it is."""
    folder = ROOT / (sys.argv[1] if len(sys.argv) > 1 else "handout")
    print(f"{len(hand_out(folder))} notebooks without solutions: {folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
