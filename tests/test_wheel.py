"""The wheel carries all that the library needs. That it works without the clone is what `make wheel` tries."""

import importlib.metadata
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

CLONE = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def carried(tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    """The names of the wheel's files."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", folder, CLONE]
    subprocess.run(command, check=True, capture_output=True, cwd=folder)
    (built,) = folder.glob("gvp_lib-*.whl")
    with zipfile.ZipFile(built) as archive:
        return set(archive.namelist())


def test_the_wheel_carries_types_and_every_model_page_and_weight(carried: set[str]) -> None:
    kept = {".py", ".pyi", ".xml", ".typed", ".safetensors", ".html", ".css", ".js"}
    needed = {str(file.relative_to(CLONE)) for file in (CLONE / "gvp_lib").rglob("*") if file.suffix in kept}
    needed |= {str(file.relative_to(CLONE / "book")) for file in (CLONE / "book" / "gvp_book").rglob("*.py")}
    assert {"gvp_lib/py.typed", "gvp_lib/views/page/scene.html"} <= needed
    assert needed - carried == set()


def test_the_wheel_carries_nothing_but_the_two_packages_and_their_license(carried: set[str]) -> None:
    version = importlib.metadata.version("gvp_lib")
    assert {name.split("/")[0] for name in carried} == {"gvp_lib", "gvp_book", f"gvp_lib-{version}.dist-info"}
    assert any(name.endswith("licenses/LICENSE") for name in carried)
