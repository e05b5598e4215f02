"""``gvp doctor`` and the command line."""

import importlib.metadata
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from gvp_lib import cli, doctor
from gvp_lib.doctor import Check


def test_a_need_that_is_met_is_one_line() -> None:
    assert str(Check("disk", True, "3 GB free")) == "[OK]   disk       3 GB free"


def test_a_need_that_is_not_met_comes_with_its_mend() -> None:
    first, second = str(Check("disk", False, "1 GB free", "make room")).splitlines()
    assert first.startswith("[FAIL] disk")
    assert second.strip() == "mend: make room"


def test_an_optional_need_that_is_absent_is_no_failure(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(doctor, "CHECKS", {"gpu": lambda: Check("gpu", None, "none")})
    assert doctor.examine() == 0
    assert capsys.readouterr().out.startswith("[ -- ] gpu")


def test_one_failure_among_many_makes_the_status_1(monkeypatch: pytest.MonkeyPatch) -> None:
    checks = {"a": lambda: Check("a", False, "broken", "mend it"), "b": lambda: Check("b", True, "fine")}
    monkeypatch.setattr(doctor, "CHECKS", checks)
    assert doctor.examine() == 1
    assert doctor.examine(["b"]) == 0


def test_an_unknown_need_is_refused_and_the_known_ones_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["doctor", "rendring"]) == 2
    text = capsys.readouterr().err
    assert "Did you mean 'rendering'?" in text
    assert "packages" in text


@pytest.mark.check
def test_this_machine_is_ready(capsys: pytest.CaptureFixture[str]) -> None:
    status = cli.main(["doctor"])
    output = capsys.readouterr().out
    assert status == 0, output
    lines = output.splitlines()
    assert [line.split("]")[1].split()[0] for line in lines if line.startswith("[")] == list(doctor.CHECKS)


def test_an_old_python_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "OLDEST_PYTHON", (4, 0))
    found = doctor.check_python()
    assert found.ok is False
    assert "older than 4.0" in found.detail


def test_a_package_that_is_missing_or_another_version_is_named() -> None:
    numpy = importlib.metadata.version("numpy")
    wanted = [Requirement(f"numpy=={numpy}"), Requirement("scipy==0.1"), Requirement("no-such-package==1.0")]
    found = doctor._compare(wanted, "the lock", "set up anew")
    assert found.ok is False
    assert found.detail.startswith("2 of 3 not as in the lock: scipy is ")
    assert "no-such-package is missing" in found.detail
    assert found.mend == "set up anew"


def test_another_build_of_the_pinned_version_is_that_version(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.metadata, "version", lambda name: "2.13.0+cpu")
    assert doctor._problem(Requirement("torch==2.13.0")) == ""


def test_the_lock_pins_every_package_exactly() -> None:
    files = [doctor.CLONE / "environment" / name for name in ("lock.txt", "lock-cuda.txt")]
    lines = [line for file in files for line in file.read_text("utf-8").splitlines() if re.match(r"\w", line)]
    assert len(lines) > 100
    for line in lines:
        assert re.match(r"[a-z0-9-]+==[0-9][^ ]*( ; .+)?$", line), line


def test_the_lock_has_all_that_the_project_asks_for() -> None:
    pinned = {need.name: need for need in doctor.locked()}
    for line in importlib.metadata.requires("gvp_lib") or []:
        need = Requirement(line)
        version = str(pinned[need.name].specifier).removeprefix("==")
        assert need.specifier.contains(version), line


def test_without_a_lock_the_packages_are_held_against_the_requirements(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "in_clone", lambda: False)
    found = doctor.check_packages()
    assert found.ok
    assert "no clone, so no lock" in found.detail


def test_a_frame_is_really_drawn() -> None:
    found = doctor.check_rendering()
    assert found.ok, found
    assert re.match(r"640x480 in \d+\.\d ms, the first in \d+ ms", found.detail)


def test_a_renderer_that_does_not_exist_fails_with_a_mend(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "no-such-backend")
    found = doctor.check_rendering()
    assert found.ok is False
    assert "no-such-backend" in found.detail
    assert found.mend


def test_a_missing_libegl_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "find_library", lambda name: None)
    monkeypatch.setattr(doctor, "_DRAW", [sys.executable, "-c", "None.eglQueryString"])
    monkeypatch.setattr(sys, "platform", "linux")
    assert "libEGL is not installed" in doctor.check_rendering().detail


def test_a_renderer_that_hangs_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_DRAW", [sys.executable, "-c", "import time; time.sleep(60)"])
    found = doctor.check_rendering(timeout=0.2)
    assert found.ok is False
    assert "no frame after 0.2 s" in found.detail


def test_a_black_picture_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    report = json.dumps({"first": 0.1, "frame": 0.01, "red": False, "driver": "a driver"})
    monkeypatch.setattr(doctor, "_DRAW", [sys.executable, "-c", f"print({report!r})"])
    assert doctor.check_rendering().ok is False


def test_a_full_disk_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "FREE_DISK", 1e18)
    assert doctor.check_disk().ok is False


def test_a_closed_loopback_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*args: object, **options: object) -> None:
        raise PermissionError("not permitted")

    monkeypatch.setattr("socket.create_server", refuse)
    found = doctor.check_port()
    assert found.ok is False
    assert "127.0.0.1" in found.mend


def test_no_gpu_is_no_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_nvidia_card", lambda: "")
    assert doctor.check_gpu().ok in {True, None}


@pytest.mark.check
def test_version_is_printed() -> None:
    output = subprocess.run([sys.executable, "-m", "gvp_lib", "--version"], capture_output=True, text=True, check=True)
    assert re.fullmatch(r"gvp_lib \d+\.\d+\.\d+\n", output.stdout)


def test_the_package_and_its_metadata_agree_on_the_version() -> None:
    import gvp_lib

    assert importlib.metadata.version("gvp_lib") == gvp_lib.__version__
    assert Path(gvp_lib.__file__).parent.name == "gvp_lib"
