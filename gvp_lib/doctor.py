"""``gvp doctor``: check what this machine has and lacks, and say how to fix what is missing.

Every check is a function without arguments that returns a :class:`Finding`; whatever it finds, it raises no exception.
"""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING

from gvp_lib.errors import RenderingError, UnknownNameError

if TYPE_CHECKING:
    from packaging.requirements import Requirement

__all__ = ["CHECKS", "Finding", "examine"]

CLONE = Path(__file__).resolve().parents[1]  # the folder that holds gvp_lib: a clone, or site-packages
SETUP = "environment/setup.sh"
OLDEST_PYTHON = (3, 11)
FREE_DISK = 2e9  # bytes: for the built book, caches, and a data set to train on

_MARKS = {True: "[OK]", False: "[FAIL]", None: "[ -- ]"}
_DRAW = [sys.executable, "-c", "from gvp_lib.doctor import draw_a_box; draw_a_box()"]
_DRAW_TIMEOUT = 60.0  # s
_BOX = """
<mujoco>
  <worldbody>
    <light pos="0 0 3" castshadow="false"/>
    <geom type="box" size="1 1 0.1" rgba="1 0 0 1"/>
    <camera pos="0 0 1"/>
  </worldbody>
</mujoco>
"""


@dataclass(frozen=True, slots=True)
class Finding:
    """Result of one check.

    Attributes
    ----------
    ok
        True: passed. False: failed, and something will not work. None: optional, and absent.
    detail
        What was found, in one line.
    mend
        How to fix it; empty if nothing needs fixing.
    """

    ok: bool | None
    detail: str
    mend: str = ""

    def __repr__(self) -> str:
        return f"Finding({shorten(f'{_MARKS[self.ok]} {self.detail}', 140, placeholder=' ...')})"


def examine(needs: Iterable[str] = ()) -> int:
    """Print a line about each need, of all in :data:`CHECKS` where none is named; the exit status, 1 if any failed.

    Raises
    ------
    UnknownNameError
        There is no such need.
    """
    needs = list(needs) or list(CHECKS)
    for name in needs:
        if name not in CHECKS:
            raise UnknownNameError("check", name, CHECKS)
    failed = False
    for name in needs:
        found = CHECKS[name]()
        failed |= found.ok is False
        print(f"{_MARKS[found.ok]:<6} {name:<10} {found.detail}", flush=True)
        if found.mend:
            print(f"{'':<17} fix: {found.mend}", flush=True)
    return int(failed)


# --- packages ---------------------------------------------------------------------------------------------------------


def check_python() -> Finding:
    """Check that Python is recent enough."""
    version, oldest = (".".join(map(str, parts)) for parts in (sys.version_info[:3], OLDEST_PYTHON))
    if sys.version_info >= OLDEST_PYTHON:
        return Finding(True, f"{version} in {sys.prefix}")
    return Finding(False, f"{version} is older than {oldest}", f"PYTHON=python{oldest} {SETUP}")


def check_packages() -> Finding:
    """Check the installed packages: in a clone against the lock, elsewhere against this package's requirements."""
    if in_clone():
        wanted, source, mend = locked(), "environment/lock.txt", f"run {SETUP}"
    else:
        wanted = _applicable(metadata.requires("gvp_lib") or [])
        source = "this package's own requirements (no clone, so no lock)"
        mend = "reinstall this package with pip, which installs what it needs"
    wrong = []
    for need in wanted:
        try:
            found = metadata.version(need.name)
        except metadata.PackageNotFoundError:
            wrong.append(f"{need.name} is missing")
            continue
        if not need.specifier.contains(found, prereleases=True):  # `==1.2` admits 1.2+cpu, another build
            wrong.append(f"{need.name} is {found}, not {need.specifier}")
    if not wrong:
        return Finding(True, f"all {len(wanted)} as in {source}")
    named = "; ".join(wrong[:3]) + (f" and {len(wrong) - 3} more" if len(wrong) > 3 else "")
    return Finding(False, f"{len(wrong)} of {len(wanted)} not as in {source}: {named}", mend)


def in_clone() -> bool:
    """Whether this package runs from a clone, which has a lock, rather than from a wheel."""
    return (CLONE / "environment/lock.txt").is_file() and (CLONE / "pyproject.toml").is_file()


def locked() -> list[Requirement]:
    """Pinned packages of the clone's lock for this system; with those for CUDA if torch was built for it."""
    files = ["lock.txt", "lock-cuda.txt"] if torch_has_cuda() else ["lock.txt"]
    lines = [line for file in files for line in (CLONE / "environment" / file).read_text("utf-8").splitlines()]
    return _applicable(line for line in lines if line and not line.lstrip().startswith("#"))


def torch_has_cuda() -> bool:
    """Whether the installed torch was built for CUDA, from its metadata: importing it would take seconds."""
    try:
        needs = metadata.requires("torch") or []
    except metadata.PackageNotFoundError:
        return False
    return any(need.startswith(("nvidia-", "cuda-")) for need in needs)


def _applicable(lines: Iterable[str]) -> list[Requirement]:
    """Requirements without an extra that hold on this system."""
    from packaging.requirements import Requirement

    needs = map(Requirement, lines)
    return [need for need in needs if need.marker is None or need.marker.evaluate({"extra": ""})]


# --- rendering --------------------------------------------------------------------------------------------------------


def check_rendering() -> Finding:
    """Check that MuJoCo renders the right image without a screen, and how long that takes."""
    backend = os.environ.get("MUJOCO_GL") or "MuJoCo's default"  # egl on Linux: gvp_lib has set it
    try:
        # A process of its own, since a graphics driver that fails may take the whole process with it.
        result = subprocess.run(_DRAW, capture_output=True, text=True, timeout=_DRAW_TIMEOUT)
    except subprocess.TimeoutExpired:
        reason = f"no frame after {_DRAW_TIMEOUT:g} s"
    else:
        if result.returncode == 0:
            return Finding(True, f"{result.stdout.strip().splitlines()[-1]} ({backend})")
        reason = (result.stderr.strip().splitlines() or [f"the process ended with {result.returncode}"])[-1]
    return Finding(False, f"{reason} ({backend})", RenderingError(reason).mend)


def draw_a_box(frames: int = 10) -> None:
    """Render a red box and print the time and the driver; exit with a message if there is no image or it is not red."""
    try:
        from gvp_lib.simulation.camera import renderer  # noqa: I001 - first: MuJoCo's own error does not say what is missing
        import mujoco

        model = mujoco.MjModel.from_xml_string(_BOX)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        times = [time.perf_counter()]
        with renderer(model, 640, 480) as drawing:
            for _ in range(frames + 1):
                drawing.update_scene(data, camera=0)
                image = drawing.render()
                times.append(time.perf_counter())
            driver = _driver()
    except RenderingError as error:
        sys.exit(f"no frame: {error.reason}")
    red, green, _ = (int(value) for value in image.mean(axis=(0, 1)))
    if not (red > 100 and red > 2 * green):
        sys.exit(f"a red box was drawn by {driver}, but the image is not red")
    first, others = 1e3 * (times[1] - times[0]), 1e3 * (times[-1] - times[1]) / frames
    print(f"640x480 in {others:.1f} ms, the first in {first:.0f} ms, by {driver}")


def _driver() -> str:
    """Name of what draws, while it does."""
    try:
        from OpenGL import GL

        return bytes(GL.glGetString(GL.GL_RENDERER)).decode()
    except Exception:  # nothing depends on the name, and OpenGL bindings can fail in many ways
        return "an unnamed driver"


# --- the machine ------------------------------------------------------------------------------------------------------


def check_port() -> Finding:
    """Check that a server on this machine can be reached, as the 3D view needs."""
    try:
        with socket.create_server(("127.0.0.1", 0)) as server:
            port = server.getsockname()[1]
            with socket.create_connection(("127.0.0.1", port), timeout=5):
                return Finding(True, f"127.0.0.1:{port} is free and answers")
    except OSError as error:
        mend = "allow connections to 127.0.0.1, which a firewall or sandbox blocks"
        return Finding(False, f"a server on 127.0.0.1 cannot be reached: {error}", mend)


def check_disk() -> Finding:
    """Check that there is enough free disk space where the work is done."""
    place = CLONE if in_clone() else Path.cwd()
    free = shutil.disk_usage(place).free
    mend = "" if free >= FREE_DISK else f"free another {(FREE_DISK - free) / 1e9:.1f} GB"
    return Finding(not mend, f"{free / 1e9:.1f} GB free in {place}", mend)


def check_gpu() -> Finding:
    """Check for a GPU and a torch that can use it; optional, for networks can be trained on the CPU."""
    command = ["nvidia-smi", "--query-gpu=name", "--format=csv,noheader"]
    try:
        names = subprocess.run(command, capture_output=True, text=True, timeout=20, check=True).stdout
    except (OSError, subprocess.SubprocessError):
        names = ""
    card = names.strip().split("\n")[0]
    if find_spec("torch") is None:
        mend = "install this package with its extra 'learning'"
        return Finding(None, f"{card or 'none'}; torch is not installed", mend)
    try:
        import torch
    except (ImportError, OSError) as error:  # OSError: one of its shared libraries does not load
        return Finding(False, f"torch is installed, but cannot be imported: {error}", f"remove .venv, then {SETUP}")
    version = f"torch {torch.__version__}"
    if torch.cuda.is_available():
        return Finding(True, f"{torch.cuda.get_device_name()}, used by {version}")
    if torch.backends.mps.is_available():
        return Finding(True, f"Apple's, used by {version}")
    if not card:
        return Finding(None, f"none, and none is needed; {version} runs on the CPU")
    mend = "update the NVIDIA driver" if torch_has_cuda() else f"GVP_TORCH=cuda {SETUP}"
    return Finding(None, f"{card}, but {version} cannot use it", mend)


def check_jupyter() -> Finding:
    """Check that Jupyter would run notebooks with this Python."""
    if find_spec("ipykernel") is None or find_spec("jupyter_client") is None:
        if in_clone():
            return Finding(False, "ipykernel is not installed", f"run {SETUP}")
        return Finding(None, "not installed, so no notebooks", "install this package with its extra 'notebooks'")
    from jupyter_client.kernelspec import KernelSpecManager

    kernel = KernelSpecManager().get_kernel_spec("python3").argv[0]
    if Path(kernel) == Path(sys.executable) or kernel in {"python", "python3"}:
        return Finding(True, f"the kernel 'python3' is {sys.executable}")
    mend = f"{sys.executable} -m ipykernel install --sys-prefix"
    return Finding(False, f"the kernel 'python3' is {kernel}, not {sys.executable}", mend)


CHECKS: dict[str, Callable[[], Finding]] = {
    "python": check_python,
    "packages": check_packages,
    "rendering": check_rendering,
    "port": check_port,
    "disk": check_disk,
    "gpu": check_gpu,
    "jupyter": check_jupyter,
}
