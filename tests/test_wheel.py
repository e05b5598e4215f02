"""The wheel carries all that the library needs and nothing else. That it works alone is what `make wheel` tries."""

import subprocess
import sys
import zipfile
from pathlib import Path

from snippets import ROOT

import gvp_lib


def test_the_wheel_carries_types_and_every_model_page_and_weight_and_nothing_but_the_two_packages(
    tmp_path: Path,
) -> None:
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", tmp_path, ROOT]
    subprocess.run(command, check=True, capture_output=True, cwd=tmp_path)
    (built,) = tmp_path.glob("gvp_lib-*.whl")
    with zipfile.ZipFile(built) as archive:
        carried = set(archive.namelist())
    kept = {".py", ".pyi", ".xml", ".png", ".typed", ".safetensors", ".html", ".css", ".js"}
    needed = {str(file.relative_to(ROOT)) for file in (ROOT / "gvp_lib").rglob("*") if file.suffix in kept}
    needed |= {
        str(file.relative_to(ROOT / "book"))
        for file in (ROOT / "book" / "gvp_book").rglob("*.py*")
        if file.suffix in kept
    }
    assert {"gvp_lib/py.typed", "gvp_lib/__init__.pyi", "gvp_lib/views/page/scene.html"} <= needed
    assert needed - carried == set()
    information = f"gvp_lib-{gvp_lib.__version__}.dist-info"
    assert {name.split("/")[0] for name in carried} == {"gvp_lib", "gvp_book", information}
    assert any(name.endswith("licenses/LICENSE") for name in carried)
