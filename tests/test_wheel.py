"""The wheel carries all that the library needs, and works without the clone."""

import importlib.metadata
import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

CLONE = Path(__file__).resolve().parents[1]


def run(*command: object, cwd: Path) -> str:
    """What a command prints, in a process that the developer's own paths do not reach."""
    environment = {name: value for name, value in os.environ.items() if name not in {"PYTHONPATH", "VIRTUAL_ENV"}}
    result = subprocess.run([*map(str, command)], capture_output=True, text=True, cwd=cwd, env=environment)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    run(sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", folder, CLONE, cwd=folder)
    (built,) = folder.glob("gvp_lib-*.whl")
    return built


@pytest.fixture(scope="module")
def stranger(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python of a new environment that holds the wheel and sees this one's packages, but not the clone."""
    place = tmp_path_factory.mktemp("environment")
    venv.create(place, with_pip=False)
    python = place / "bin" / "python"
    (site,) = (place / "lib").glob("python*/site-packages")
    run(sys.executable, "-m", "uv", "pip", "install", "--offline", "--no-deps", "--python", python, wheel, cwd=place)
    # A plain path in a .pth file brings the dependencies but not the editable install of the clone beside them,
    # whose own .pth is read only in a folder of its environment.
    (site / "dependencies.pth").write_text(sysconfig.get_paths()["purelib"] + "\n", encoding="utf-8")
    return python


def test_the_wheel_carries_types_and_every_model(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        carried = set(archive.namelist())
    kept = {".py", ".xml", ".typed", ".safetensors", ".png"}
    needed = {
        str(file.relative_to(CLONE))
        for file in (CLONE / "gvp_lib").rglob("*")
        if file.suffix in kept and "__pycache__" not in file.parts
    }
    assert "gvp_lib/py.typed" in needed
    assert needed - carried == set()


def test_the_wheel_carries_nothing_but_the_library_and_its_license(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        tops = {name.split("/")[0] for name in archive.namelist()}
        assert any(name.endswith("licenses/LICENSE") for name in archive.namelist())
    version = importlib.metadata.version("gvp_lib")
    assert tops == {"gvp_lib", f"gvp_lib-{version}.dist-info"}


def test_the_wheel_works_in_an_empty_folder_without_the_clone(stranger: Path, tmp_path: Path) -> None:
    program = "import gvp_lib; print(gvp_lib.__file__); [getattr(gvp_lib, name) for name in gvp_lib.__all__]"
    output = run(stranger, "-c", program, cwd=tmp_path)
    assert Path(output.strip()).is_relative_to(stranger.parents[1])


def test_the_doctor_examines_an_installed_wheel(stranger: Path, tmp_path: Path) -> None:
    output = run(stranger.with_name("gvp"), "doctor", "python", "packages", "rendering", cwd=tmp_path)
    assert "no clone, so no lock" in output
    assert "[FAIL]" not in output
