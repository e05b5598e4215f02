"""Python, the loopback, disk, GPU and Jupyter."""

from __future__ import annotations

import shutil
import socket
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

from gvp_lib.doctor.check import CLONE, SETUP, Check, in_clone
from gvp_lib.doctor.packages import torch_has_cuda

__all__ = ["check_disk", "check_gpu", "check_jupyter", "check_port", "check_python"]

OLDEST_PYTHON = (3, 11)
FREE_DISK = 2e9  # bytes: the built book, caches, and a data set to learn from


def check_python() -> Check:
    """Python is recent enough."""
    version = ".".join(map(str, sys.version_info[:3]))
    if sys.version_info >= OLDEST_PYTHON:
        return Check("python", True, f"{version} in {sys.prefix}")
    oldest = ".".join(map(str, OLDEST_PYTHON))
    return Check("python", False, f"{version} is older than {oldest}", f"PYTHON=python{oldest} {SETUP}")


def check_port() -> Check:
    """A server on the loopback can be reached, as the 3D view's must be."""
    try:
        with socket.create_server(("127.0.0.1", 0)) as server:
            port = server.getsockname()[1]
            with socket.create_connection(("127.0.0.1", port), timeout=5):
                return Check("port", True, f"127.0.0.1:{port} is free and answers")
    except OSError as error:
        mend = "let programs connect to 127.0.0.1; a firewall or sandbox forbids it"
        return Check("port", False, f"a server on the loopback cannot be reached: {error}", mend)


def check_disk() -> Check:
    """There is room where the work is done."""
    place = CLONE if in_clone() else Path.cwd()
    free = shutil.disk_usage(place).free
    found = f"{free / 1e9:.1f} GB free in {place}"
    if free >= FREE_DISK:
        return Check("disk", True, found)
    return Check("disk", False, found, f"make room for {(FREE_DISK - free) / 1e9:.1f} GB more")


def check_gpu() -> Check:
    """Optional: a GPU, and a torch that can use it. Without one, networks train on the CPU."""
    card = _nvidia_card()
    if find_spec("torch") is None:
        return Check(
            "gpu", None, f"{card or 'none'}; torch is not installed", "install this package with its extra 'learning'"
        )
    try:
        import torch
    except (ImportError, OSError) as error:  # OSError: a library of its own that does not load
        return Check("gpu", False, f"torch is installed and cannot be imported: {error}", f"remove .venv, then {SETUP}")
    version = f"torch {torch.__version__}"
    if torch.cuda.is_available():
        return Check("gpu", True, f"{torch.cuda.get_device_name()}, by {version}")
    if torch.backends.mps.is_available():
        return Check("gpu", True, f"Apple's, by {version}")
    if not card:
        return Check("gpu", None, f"none, and none is needed; {version} runs on the CPU")
    if torch_has_cuda():
        return Check("gpu", None, f"{card}, but {version} cannot use it", "update the NVIDIA driver")
    return Check("gpu", None, f"{card}, but {version} is a CPU build", f"GVP_TORCH=cuda {SETUP}")


def _nvidia_card() -> str:
    """The name of the first NVIDIA card, or nothing."""
    command = ["nvidia-smi", "--query-gpu=name", "--format=csv,noheader"]
    try:
        names = subprocess.run(command, capture_output=True, text=True, timeout=20, check=True).stdout
    except (OSError, subprocess.SubprocessError):
        return ""
    return names.strip().split("\n")[0]


def check_jupyter() -> Check:
    """Jupyter would run a notebook on this very Python."""
    if find_spec("ipykernel") is None or find_spec("jupyter_client") is None:
        if in_clone():
            return Check("jupyter", False, "ipykernel is not installed", f"run {SETUP}")
        return Check(
            "jupyter", None, "not installed, so no notebooks", "install this package with its extra 'notebooks'"
        )
    from jupyter_client.kernelspec import KernelSpecManager

    kernel = KernelSpecManager().get_kernel_spec("python3").argv[0]
    if Path(kernel) == Path(sys.executable) or kernel in {"python", "python3"}:
        return Check("jupyter", True, f"the kernel 'python3' is {sys.executable}")
    mend = f"{sys.executable} -m ipykernel install --sys-prefix"
    return Check("jupyter", False, f"the kernel 'python3' is {kernel}, not {sys.executable}", mend)
