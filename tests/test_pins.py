"""Every pin of the lock has a wheel on every supported system: `environment/check_pins.sh`. It asks the registry."""

import os
import subprocess
import sys

import pytest
from snippets import ROOT

INTEL_MAC = ["x86_64-apple-darwin", "3.11"]  # for which torch is no longer built


@pytest.mark.full
@pytest.mark.parametrize(
    ("system_and_python", "status", "told"), [([], 0, ["[OK]"] * 3 * 4), (INTEL_MAC, 1, ["[FAIL]", "wheels"])]
)
def test_every_pin_has_a_wheel_for_every_supported_system_and_one_without_is_named(system_and_python, status, told):
    command = [ROOT / "environment" / "check_pins.sh", *system_and_python]
    found = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "GVP_VENV": sys.prefix})
    assert found.returncode == status, found.stdout + found.stderr
    for words in set(told):
        assert found.stdout.count(words) >= told.count(words)
