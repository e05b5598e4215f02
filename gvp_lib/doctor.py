"""``gvp doctor``: what this machine has and lacks, each lack with its mend.

Every check is a function of nothing that returns a :class:`Check`; what it finds, however bad, is no exception.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from ctypes.util import find_library
from dataclasses import dataclass
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from gvp_lib.errors import UnknownNameError

if TYPE_CHECKING:
    from packaging.requirements import Requirement

__all__ = ["CHECKS", "Check", "examine"]

CLONE = Path(__file__).resolve().parents[1]  # the folder of gvp_lib: a clone, or else site-packages
SETUP = "environment/setup.sh"
OLDEST_PYTHON = (3, 11)
FREE_DISK = 2e9  # bytes: the built book, caches, and a data set to learn from

_NAMED = 3  # at most so many problems with packages are named
_DRAW = [sys.executable, "-c", "from gvp_lib.doctor import draw_a_box; draw_a_box()"]
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
class Check:
    """Finding about one need.

    Attributes
    ----------
    name
        The need.
    ok
        True: met. False: not met, and something will not work. None: optional, and absent.
    detail
        What was found, in a line.
    mend
        What to do about it; empty where nothing need be done.
    """

    name: str
    ok: bool | None
    detail: str
    mend: str = ""

    def __str__(self) -> str:
        mark = {True: "[OK]  ", False: "[FAIL]", None: "[ -- ]"}[self.ok]
        line = f"{mark} {self.name:<10} {self.detail}"
        return f"{line}\n{'':<17} mend: {self.mend}" if self.mend else line


def examine(needs: Iterable[str] = ()) -> int:
    """Print what is found about each need.

    Parameters
    ----------
    needs
        Names in `CHECKS`; empty for all of them.

    Returns
    -------
    int
        Exit status: 0 if nothing failed, else 1.

    Raises
    ------
    UnknownNameError
        For a need that is not in `CHECKS`.
    """
    needs = list(needs) or list(CHECKS)
    for name in needs:
        if name not in CHECKS:
            raise UnknownNameError("need", name, CHECKS)
    failed = False
    for name in needs:
        found = CHECKS[name]()
        failed |= found.ok is False
        print(found, flush=True)
    return int(failed)


def check_python() -> Check:
    """Python is recent enough."""
    version = ".".join(map(str, sys.version_info[:3]))
    if sys.version_info >= OLDEST_PYTHON:
        return Check("python", True, f"{version} in {sys.prefix}")
    oldest = ".".join(map(str, OLDEST_PYTHON))
    return Check("python", False, f"{version} is older than {oldest}", f"PYTHON=python{oldest} {SETUP}")


# --- packages ---------------------------------------------------------------------------------------------------------


def in_clone() -> bool:
    """Whether this package runs from a clone, which has a lock, or from a wheel, which has none."""
    return (CLONE / "environment/lock.txt").is_file() and (CLONE / "pyproject.toml").is_file()


def check_packages() -> Check:
    """In a clone: the packages are those of the lock. Elsewhere: they are in the ranges the package asks for."""
    if in_clone():
        wanted, source, mend = locked(), "environment/lock.txt", f"run {SETUP}"
    else:
        wanted = _applicable(metadata.requires("gvp_lib") or [])
        source = "this package's own requirements (no clone, so no lock)"
        mend = "install this package anew with pip, which brings what it needs"
    return _compare(wanted, source, mend)


def locked() -> list[Requirement]:
    """Pins of the clone's lock for this system, and for CUDA where torch was built for it."""
    files = ["lock.txt", "lock-cuda.txt"] if torch_has_cuda() else ["lock.txt"]
    lines = [line for file in files for line in (CLONE / "environment" / file).read_text("utf-8").splitlines()]
    return _applicable(line for line in lines if line and not line.lstrip().startswith("#"))


def torch_has_cuda() -> bool:
    """Whether the installed torch was built for CUDA, by its metadata: importing it would take seconds."""
    try:
        needs = metadata.requires("torch") or []
    except metadata.PackageNotFoundError:
        return False
    return any(need.startswith(("nvidia-", "cuda-")) for need in needs)


def _applicable(lines: Iterable[str]) -> list[Requirement]:
    from packaging.requirements import Requirement

    needs = map(Requirement, lines)
    return [need for need in needs if need.marker is None or need.marker.evaluate({"extra": ""})]


def _compare(wanted: list[Requirement], source: str, mend: str) -> Check:
    wrong = [problem for need in wanted if (problem := _problem(need))]
    if not wrong:
        return Check("packages", True, f"all {len(wanted)} as in {source}")
    more = f" and {len(wrong) - _NAMED} more" if len(wrong) > _NAMED else ""
    named = "; ".join(wrong[:_NAMED]) + more
    return Check("packages", False, f"{len(wrong)} of {len(wanted)} not as in {source}: {named}", mend)


def _problem(need: Requirement) -> str:
    """What is wrong with one package, or nothing."""
    try:
        found = metadata.version(need.name)
    except metadata.PackageNotFoundError:
        return f"{need.name} is missing"
    # `==2.13.0` admits 2.13.0+cpu: another build of the same version.
    return "" if need.specifier.contains(found, prereleases=True) else f"{need.name} is {found}, not {need.specifier}"


# --- drawing ----------------------------------------------------------------------------------------------------------


def check_rendering(timeout: float = 60.0) -> Check:
    """MuJoCo draws a frame without a screen, the frame shows what it should, and how long it took.

    Parameters
    ----------
    timeout
        Time to wait for it, s.
    """
    environment = dict(os.environ)
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        environment.setdefault("MUJOCO_GL", "egl")
    backend = environment.get("MUJOCO_GL") or "MuJoCo's default"
    try:
        # A process of its own, since a graphics driver that fails may take the whole process with it.
        result = subprocess.run(_DRAW, capture_output=True, text=True, timeout=timeout, env=environment)
    except subprocess.TimeoutExpired:
        return _not_drawn(f"no frame after {timeout:g} s ({backend})")
    if result.returncode != 0:
        reason = (result.stderr.strip().splitlines() or [f"the process ended with {result.returncode}"])[-1]
        if sys.platform == "linux" and find_library("EGL") is None:  # without it the bindings fail, and don't say so
            reason = "libEGL is not installed"
        return _not_drawn(f"no frame ({backend}): {reason}")
    drawn = json.loads(result.stdout.strip().splitlines()[-1])
    if not drawn["red"]:
        return _not_drawn(f"a red box was drawn and the picture is not red ({backend}, {drawn['driver']})")
    times = f"640x480 in {1e3 * drawn['frame']:.1f} ms, the first in {1e3 * drawn['first']:.0f} ms"
    return Check("rendering", True, f"{times} ({backend}, {drawn['driver']})")


def draw_a_box(frames: int = 10) -> None:
    """Draw a red box, and print as JSON the time of the first frame and of one of the next (``first``, ``frame``, s),
    whether the picture shows the box (``red``), and the ``driver``."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(_BOX)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    start = time.perf_counter()
    with mujoco.Renderer(model, height=480, width=640) as renderer:
        renderer.update_scene(data, camera=0)
        renderer.render()
        first = time.perf_counter()
        for _ in range(frames):
            renderer.update_scene(data, camera=0)
            image = renderer.render()
        last = time.perf_counter()
        try:
            from OpenGL import GL

            driver = bytes(GL.glGetString(GL.GL_RENDERER)).decode()
        except Exception:  # nothing depends on the name, and OpenGL bindings fail in many ways
            driver = "an unnamed driver"
    red, green, _ = (int(value) for value in image.mean(axis=(0, 1)))
    drawn = {"first": first - start, "frame": (last - first) / frames, "red": red > 100 and red > 2 * green}
    print(json.dumps({**drawn, "driver": driver}))


def _not_drawn(detail: str) -> Check:
    if sys.platform == "darwin":
        mend = "unset MUJOCO_GL and run in a session logged in on the Mac's own screen"
    elif shutil.which("apt-get"):
        mend = "sudo apt-get install libegl1 libgl1 libgl1-mesa-dri, then set MUJOCO_GL=egl"
    elif shutil.which("dnf"):
        mend = "sudo dnf install mesa-libEGL mesa-libGL mesa-dri-drivers, then set MUJOCO_GL=egl"
    else:
        mend = "install Mesa's EGL and DRI drivers (Arch, Alpine: mesa), then set MUJOCO_GL=egl"
    return Check("rendering", False, detail, mend)


# --- the machine ------------------------------------------------------------------------------------------------------


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
    missing = FREE_DISK - free
    mend = f"make room for {missing / 1e9:.1f} GB more" if missing > 0 else ""
    return Check("disk", missing <= 0, f"{free / 1e9:.1f} GB free in {place}", mend)


def check_gpu() -> Check:
    """Optional: a GPU, and a torch that can use it. Without one, networks train on the CPU."""
    card = _nvidia_card()
    if find_spec("torch") is None:
        mend = "install this package with its extra 'learning'"
        return Check("gpu", None, f"{card or 'none'}; torch is not installed", mend)
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
        mend = "install this package with its extra 'notebooks'"
        return Check("jupyter", None, "not installed, so no notebooks", mend)
    from jupyter_client.kernelspec import KernelSpecManager

    kernel = KernelSpecManager().get_kernel_spec("python3").argv[0]
    if Path(kernel) == Path(sys.executable) or kernel in {"python", "python3"}:
        return Check("jupyter", True, f"the kernel 'python3' is {sys.executable}")
    mend = f"{sys.executable} -m ipykernel install --sys-prefix"
    return Check("jupyter", False, f"the kernel 'python3' is {kernel}, not {sys.executable}", mend)


CHECKS: dict[str, Callable[[], Check]] = {
    "python": check_python,
    "packages": check_packages,
    "rendering": check_rendering,
    "port": check_port,
    "disk": check_disk,
    "gpu": check_gpu,
    "jupyter": check_jupyter,
}
