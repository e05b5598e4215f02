"""What the scripts in `environment/` decide and refuse, without installing anything."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from snippets import ROOT

ENVIRONMENT = ROOT / "environment"
A_GPU = "GPU 0: NVIDIA RTX A2000 (UUID: GPU-0)"


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere torch has one build, and nothing is decided")
@pytest.mark.parametrize(
    ("choice", "listed", "status", "device", "torch"),
    [
        ("auto", "NVIDIA-SMI has failed", 9, True, "cuda"),  # a GPU is known by its device
        ("auto", A_GPU, 0, False, "cuda"),  # or by NVIDIA's program
        ("auto", "No devices found.", 6, False, "any"),  # a driver without a GPU is none
        ("auto", "NVIDIA-SMI has failed", 9, False, "any"),
        ("cpu", A_GPU, 0, True, "cpu"),  # a choice wins over what is found
        ("cuda", "", 0, False, "cuda"),
    ],
)
def test_torch_is_chosen_by_the_gpu_that_is_there(
    tmp_path: Path, choice: str, listed: str, status: int, device: bool, torch: str
) -> None:
    program = tmp_path / "nvidia-smi"
    program.write_text(f"#!/bin/sh\necho '{listed}'\nexit {status}\n", encoding="utf-8")
    program.chmod(0o755)
    if device:
        (tmp_path / "nvidia0").touch()
    script = f'. {ENVIRONMENT}/packages.sh && nvidia_devices="{tmp_path}/nvidia[0-9]*" && torch_for {choice}'
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    said = subprocess.check_output(["bash", "-euo", "pipefail", "-c", script], text=True, env=environment)
    assert said.strip() == torch


def test_setup_refuses_a_build_that_does_not_exist(tmp_path: Path) -> None:
    environment = {**os.environ, "GVP_TORCH": "rocm", "GVP_VENV": str(tmp_path / "environment")}
    result = subprocess.run([ENVIRONMENT / "setup.sh"], capture_output=True, text=True, env=environment)
    assert result.returncode == 1
    for choice in ("'rocm'", "'cpu'", "'cuda'", "'auto'"):
        assert choice in result.stderr
    assert not (tmp_path / "environment").exists()


INTEL_MAC = ["x86_64-apple-darwin", "3.11"]  # for which torch is no longer built


@pytest.mark.full  # it asks the registry
@pytest.mark.parametrize(
    ("system_and_python", "status", "said"), [([], 0, ["[OK]"] * 3 * 4), (INTEL_MAC, 1, ["[FAIL]", "wheels"])]
)
def test_every_pin_has_a_wheel_for_every_supported_system_and_one_without_is_named(system_and_python, status, said):
    command = [ROOT / "environment" / "check_pins.sh", *system_and_python]
    found = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "GVP_VENV": sys.prefix})
    assert found.returncode == status, found.stdout + found.stderr
    for words in set(said):
        assert found.stdout.count(words) >= said.count(words)
