"""Every pin of the lock has a wheel on every supported system: `environment/check_pins.sh`. It asks the registry."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

CHECK_PINS = Path(__file__).resolve().parents[1] / "environment" / "check_pins.sh"
pytestmark = pytest.mark.full


def check_pins(*system_and_python: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "GVP_VENV": sys.prefix}
    return subprocess.run([CHECK_PINS, *system_and_python], capture_output=True, text=True, env=environment)


def test_every_pin_has_a_wheel_for_every_supported_system_and_python() -> None:
    found = check_pins()
    assert found.returncode == 0, found.stdout + found.stderr
    assert found.stdout.count("[OK]") == 3 * 4


def test_a_pin_without_a_wheel_is_named() -> None:
    found = check_pins("x86_64-apple-darwin", "3.11")  # torch is no longer built for Intel's Macs
    assert found.returncode == 1
    assert "[FAIL]" in found.stdout
    assert "wheels" in found.stdout
