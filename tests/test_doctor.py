"""``gvp doctor``: each check on this machine, and as it would be on one that lacks something."""

import importlib.metadata
import re
import sys

import pytest
from packaging.requirements import Requirement

from gvp_lib import cli, doctor
from gvp_lib.doctor import Finding


@pytest.mark.check
def test_this_machine_is_ready(capsys):
    status = cli.main(["doctor"])
    output = capsys.readouterr().out
    assert status == 0, output
    assert [line.split("]")[1].split()[0] for line in output.splitlines() if line[0] == "["] == list(doctor.CHECKS)
    assert re.search(r"\[OK\]   rendering  640x480 in \d+\.\d ms, the first in \d+ ms, by .* \(", output)


def test_a_check_is_a_line_and_a_failure_has_its_fix_and_status_1(monkeypatch, capsys):
    checks = {"gpu": Finding(None, "none"), "disk": Finding(False, "1 GB free", "make room")}
    monkeypatch.setattr(doctor, "CHECKS", {name: lambda found=found: found for name, found in checks.items()})
    assert doctor.examine() == 1
    lines = ["[ -- ] gpu        none", "[FAIL] disk       1 GB free", "                  fix: make room"]
    assert capsys.readouterr().out.splitlines() == lines
    assert doctor.examine(["gpu"]) == 0


def test_an_unknown_check_is_refused_and_the_known_ones_listed(capsys):
    assert cli.main(["doctor", "rendring"]) == 2
    assert re.search(r"Did you mean 'rendering'\?.*packages", capsys.readouterr().err)


def test_a_package_that_is_missing_or_another_version_is_named_but_not_another_build(monkeypatch):
    wanted = ["torch==2.5", "scipy==0.1", "no-such-package==1.0"]
    monkeypatch.setattr(doctor, "in_clone", lambda: True)
    monkeypatch.setattr(doctor, "locked", lambda: [Requirement(line) for line in wanted])
    real = importlib.metadata.version
    monkeypatch.setattr(importlib.metadata, "version", lambda name: "2.5+cpu" if name == "torch" else real(name))
    found = doctor.check_packages()
    assert found.ok is False
    assert found.detail.startswith("2 of 3 not as in environment/lock.txt: scipy is ")
    assert "no-such-package is missing" in found.detail
    assert found.mend == "run environment/setup.sh"


def test_without_a_lock_the_packages_are_held_against_the_requirements(monkeypatch):
    monkeypatch.setattr(doctor, "in_clone", lambda: False)
    found = doctor.check_packages()
    assert found.ok
    assert "no clone, so no lock" in found.detail


def test_the_lock_pins_every_package_exactly_and_has_all_that_the_project_asks_for():
    files = [doctor.CLONE / "environment" / name for name in ("lock.txt", "lock-cuda.txt")]
    lines = [line for file in files for line in file.read_text("utf-8").splitlines() if re.match(r"\w", line)]
    assert [line for line in lines if not re.match(r"[a-z0-9-]+==[0-9][^ ]*( ; .+)?$", line)] == []
    pinned = {need.name: str(need.specifier).removeprefix("==") for need in doctor.locked()}
    for need in map(Requirement, importlib.metadata.requires("gvp_lib")):
        assert need.specifier.contains(pinned[need.name]), need


def refuse(*_, **__):
    raise PermissionError("not permitted")


@pytest.mark.parametrize(
    ("need", "name", "value", "detail", "mend"),
    [
        ("python", "OLDEST_PYTHON", (4, 0), r"older than 4\.0", "PYTHON=python4.0"),
        ("disk", "FREE_DISK", 1e18, "GB free in ", r"free another .* GB"),
        ("port", "socket.create_server", refuse, "cannot be reached: not permitted", r"127\.0\.0\.1, which a firewall"),
        ("jupyter", "find_spec", lambda name: None, "ipykernel is not installed", r"run environment/setup\.sh"),
    ],
)
def test_a_machine_that_lacks_something_is_told_how_to_fix_it(need, name, value, detail, mend, monkeypatch):
    monkeypatch.setattr(f"gvp_lib.doctor.{name}", value)
    found = doctor.CHECKS[need]()
    assert found.ok is False
    assert re.search(detail, found.detail)
    assert re.search(mend, found.mend)


@pytest.mark.parametrize(
    ("program", "timeout", "said"),
    [
        (doctor._DRAW[-1], 60.0, r"no frame: .*invalid value .* MUJOCO_GL: no-such-backend \(no-such-backend\)"),
        ("import time; time.sleep(60)", 0.5, r"no frame after 0\.5 s \(no-such-backend\)"),
    ],
)
def test_an_image_that_is_not_drawn_is_a_failure_with_a_fix(program, timeout, said, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "no-such-backend")
    monkeypatch.setattr(doctor, "_DRAW", [sys.executable, "-c", program])
    monkeypatch.setattr(doctor, "_DRAW_TIMEOUT", timeout)
    monkeypatch.setattr(sys, "platform", "linux")
    found = doctor.check_rendering()
    assert (found.ok, "MUJOCO_GL=egl" in found.mend) == (False, True)
    assert re.search(said, found.detail)


def test_a_black_image_is_a_failure(monkeypatch, capsys):
    doctor.draw_a_box(1)
    assert re.match(r"640x480 in \d+\.\d ms, the first in \d+ ms, by \w", capsys.readouterr().out)
    monkeypatch.setattr(doctor, "_BOX", doctor._BOX.replace("1 0 0 1", "0 0 0 1"))
    with pytest.raises(SystemExit, match=r"a red box was drawn by .*, but the image is not red"):
        doctor.draw_a_box(1)
