"""What `environment/packages.sh` decides and `environment/setup.sh` refuses, without installing anything."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ENVIRONMENT = Path(__file__).resolve().parents[1] / "environment"
linux_only = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere torch has one build, and nothing is decided")


def torch_for(choice: str, programs: Path, devices: str = "/nowhere/nvidia*") -> str:
    """What torch is to be on a machine with these programs before its own, and these devices."""
    script = f'. {ENVIRONMENT}/packages.sh && nvidia_devices="{devices}" && torch_for {choice}'
    environment = {**os.environ, "PATH": f"{programs}:{os.environ['PATH']}"}
    command = ["bash", "-euo", "pipefail", "-c", script]
    return subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout.strip()


def nvidia_smi(folder: Path, listed: str, status: int = 0) -> None:
    """NVIDIA's program, on a machine where it lists this."""
    program = folder / "nvidia-smi"
    program.write_text(f"#!/bin/sh\necho '{listed}'\nexit {status}\n", encoding="utf-8")
    program.chmod(0o755)


@linux_only
def test_a_gpu_is_known_by_its_device(tmp_path: Path) -> None:
    nvidia_smi(tmp_path, "NVIDIA-SMI has failed", status=9)
    (tmp_path / "nvidia0").touch()
    assert torch_for("auto", tmp_path, devices=f"{tmp_path}/nvidia[0-9]*") == "cuda"


@linux_only
def test_a_gpu_without_a_device_is_known_by_nvidias_program(tmp_path: Path) -> None:
    nvidia_smi(tmp_path, "GPU 0: NVIDIA RTX A2000 (UUID: GPU-0)")
    assert torch_for("auto", tmp_path) == "cuda"


@linux_only
@pytest.mark.parametrize(("listed", "status"), [("No devices found.", 6), ("NVIDIA-SMI has failed", 9), ("", 0)])
def test_a_driver_without_a_gpu_is_none(tmp_path: Path, listed: str, status: int) -> None:
    nvidia_smi(tmp_path, listed, status)
    assert torch_for("auto", tmp_path) == "any"


@linux_only
@pytest.mark.parametrize("choice", ["cpu", "cuda"])
def test_a_choice_wins_over_what_is_found(tmp_path: Path, choice: str) -> None:
    nvidia_smi(tmp_path, "GPU 0: NVIDIA RTX A2000 (UUID: GPU-0)")
    assert torch_for(choice, tmp_path) == choice


def test_setup_refuses_a_build_that_does_not_exist(tmp_path: Path) -> None:
    environment = {**os.environ, "GVP_TORCH": "rocm", "GVP_VENV": str(tmp_path / "environment")}
    result = subprocess.run([ENVIRONMENT / "setup.sh"], capture_output=True, text=True, env=environment)
    assert result.returncode == 1
    assert "'rocm'" in result.stderr
    for choice in ("'cpu'", "'cuda'", "'auto'"):
        assert choice in result.stderr
    assert not (tmp_path / "environment").exists()
