"""``gvp doctor``: what this machine has and lacks for the book, each lack with its mend.

Every check is a function of nothing that returns a :class:`Check` and never raises for what it finds.
"""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from gvp_lib.errors import UnknownNameError

if TYPE_CHECKING:
    from packaging.requirements import Requirement

__all__ = ["CHECKS", "Check", "examine"]

OLDEST_PYTHON = (3, 11)
FREE_DISK = 2e9  # bytes: the book's build, the data sets of chapter 5 at their default size, and room to spare

_CLONE = Path(__file__).resolve().parents[1]
_LOCKS = _CLONE / "environment"
_SETUP = "environment/setup.sh"


@dataclass(frozen=True, slots=True)
class Check:
    """What was found about one need.

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
        return f"{line}\n       {'':<10} mend: {self.mend}" if self.mend else line


def check_python() -> Check:
    """Python is recent enough."""
    version = ".".join(map(str, sys.version_info[:3]))
    if sys.version_info >= OLDEST_PYTHON:
        return Check("python", True, f"{version} at {sys.prefix}")
    oldest = ".".join(map(str, OLDEST_PYTHON))
    return Check("python", False, f"{version} is older than {oldest}", f"PYTHON=python{oldest} {_SETUP}")


def check_packages() -> Check:
    """In a clone: the packages are those of the lock. Installed elsewhere: they are in the ranges asked for."""
    if _in_clone():
        wanted, source, mend = list(_locked()), "environment/lock.txt", f"run {_SETUP}"
    else:
        wanted = [need for need in _parsed(metadata.requires("gvp_lib") or []) if _applies(need)]
        source = "this package's own requirements (no clone, so no lock)"
        mend = "pip install --upgrade gvp_lib"
    wrong = [problem for need in wanted if (problem := _problem(need))]
    if not wrong:
        return Check("packages", True, f"all {len(wanted)} as in {source}")
    more = f" and {len(wrong) - 3} more" if len(wrong) > 3 else ""
    return Check("packages", False, f"{len(wrong)} of {len(wanted)} not as in {source}: "
                 f"{'; '.join(wrong[:3])}{more}", mend)  # fmt: skip


def _in_clone() -> bool:
    return (_LOCKS / "lock.txt").is_file() and (_CLONE / "pyproject.toml").is_file()


def _locked() -> Iterator[Requirement]:
    files = [_LOCKS / "lock.txt"]
    if _torch_wants_cuda():
        files.append(_LOCKS / "lock-cuda.txt")
    for file in files:
        lines = (line.strip() for line in file.read_text(encoding="utf-8").splitlines())
        yield from filter(_applies, _parsed(line for line in lines if line and not line.startswith("#")))


def _parsed(lines: Iterable[str]) -> Iterator[Requirement]:
    from packaging.requirements import Requirement

    return map(Requirement, lines)


def _applies(need: Requirement) -> bool:
    return need.marker is None or need.marker.evaluate({"extra": ""})


def _problem(need: Requirement) -> str:
    """What is wrong with an installed package, or nothing."""
    try:
        found = metadata.version(need.name)
    except metadata.PackageNotFoundError:
        return f"{need.name} is missing"
    # `==2.13.0` admits 2.13.0+cpu: another build of the same version.
    return "" if need.specifier.contains(found, prereleases=True) else f"{need.name} is {found}, not {need.specifier}"


def _torch_wants_cuda() -> bool:
    """Whether the installed torch is a build with CUDA, by its metadata: importing it takes seconds."""
    try:
        needs = metadata.requires("torch") or []
    except metadata.PackageNotFoundError:
        return False
    return any(need.startswith(("nvidia-", "cuda-")) for need in needs)


# Run in a process of its own, because a graphics driver that fails may take the whole process with it.
_DRAW = """
import json, time
start = time.perf_counter()
import mujoco
model = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><light pos='0 0 3'/><geom type='box' size='1 1 .1' rgba='1 0 0 1'/>"
    "<camera pos='0 0 1'/></worldbody></mujoco>")
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
loaded = time.perf_counter()
with mujoco.Renderer(model, 480, 640) as renderer:
    def draw():
        renderer.update_scene(data, camera=0)
        return renderer.render()
    image = draw()
    first = time.perf_counter()
    frames = 10
    for _ in range(frames):
        image = draw()
    last = time.perf_counter()
    try:
        from OpenGL import GL
        driver = GL.glGetString(GL.GL_RENDERER).decode()
    except Exception:
        driver = "a driver that does not say its name"
red, green, blue = image[240, 320].tolist()
print(json.dumps({"red": red > 60 > green, "first": first - loaded, "frame": (last - first) / frames,
                  "driver": driver}))
"""


def check_rendering(timeout: float = 60.0) -> Check:
    """MuJoCo draws a frame without a screen, and the frame shows what it should."""
    environment = dict(os.environ)
    if is_headless():
        environment.setdefault("MUJOCO_GL", "egl")
    backend = environment.get("MUJOCO_GL") or "MuJoCo's default"
    try:
        result = subprocess.run(
            [sys.executable, "-c", _DRAW], capture_output=True, text=True, timeout=timeout, env=environment
        )
    except subprocess.TimeoutExpired:
        return Check("rendering", False, f"no frame after {timeout:g} s ({backend})", _rendering_mend())
    if result.returncode != 0:
        last = (result.stderr.strip().splitlines() or [f"the process ended with {result.returncode}"])[-1]
        return Check("rendering", False, f"no frame ({backend}): {last}", _rendering_mend())
    return _judge_frame(result.stdout, backend)


def _judge_frame(report: str, backend: str) -> Check:
    import json

    drawn = json.loads(report.strip().splitlines()[-1])
    times = f"640x480 in {1e3 * drawn['frame']:.1f} ms, the first in {1e3 * drawn['first']:.0f} ms"
    if not drawn["red"]:
        return Check("rendering", False, f"a red box was drawn and is not red ({backend})", _rendering_mend())
    return Check("rendering", True, f"{times} ({backend}, {drawn['driver']})")


def is_headless() -> bool:
    """Whether this is a Linux without a screen, where MuJoCo must be told to draw by EGL."""
    return sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _rendering_mend() -> str:
    if sys.platform == "darwin":
        return "unset MUJOCO_GL and run from a session that is logged in on the Mac's own screen"
    if shutil.which("apt-get"):
        return "sudo apt-get install libegl1 libgl1 libgl1-mesa-dri, then MUJOCO_GL=egl"
    if shutil.which("dnf"):
        return "sudo dnf install mesa-libEGL mesa-libGL mesa-dri-drivers, then MUJOCO_GL=egl"
    return "install Mesa's EGL and DRI drivers (Arch, Alpine: mesa), then MUJOCO_GL=egl; see environment/README.md"


def check_port() -> Check:
    """A server can listen on the loopback and be reached there, as the 3D view's will."""
    try:
        with socket.create_server(("127.0.0.1", 0)) as server:
            port = server.getsockname()[1]
            with socket.create_connection(("127.0.0.1", port), timeout=5):
                return Check("port", True, f"127.0.0.1:{port} is free and answers")
    except OSError as error:
        return Check("port", False, f"no server can be reached on the loopback: {error}",
                     "let this machine connect to 127.0.0.1 (a firewall or sandbox forbids it)")  # fmt: skip


def check_disk() -> Check:
    """There is room where the work is done."""
    place = _CLONE if _in_clone() else Path.cwd()
    free = shutil.disk_usage(place).free
    found = f"{free / 1e9:.1f} GB free at {place}"
    if free >= FREE_DISK:
        return Check("disk", True, found)
    return Check("disk", False, found, f"free {(FREE_DISK - free) / 1e9:.1f} GB more")


def check_gpu() -> Check:
    """Optional: a GPU, and a torch that can use it."""
    card = _nvidia_card()
    if find_spec("torch") is None:
        return Check("gpu", None, f"{card or 'none'}; torch is not installed", "pip install 'gvp_lib[learning]'")
    import torch

    if torch.cuda.is_available():
        return Check("gpu", True, f"{torch.cuda.get_device_name()} by torch {torch.__version__}")
    if torch.backends.mps.is_available():
        return Check("gpu", True, f"Apple's GPU by torch {torch.__version__}")
    if card and not _torch_wants_cuda():
        return Check("gpu", None, f"{card}, but torch {torch.__version__} is a CPU build",
                     f"remove .venv, then {_SETUP} without GVP_TORCH")  # fmt: skip
    if card:
        return Check("gpu", None, f"{card}, but torch {torch.__version__} cannot use it", "update the NVIDIA driver")
    return Check("gpu", None, f"none; not needed (torch {torch.__version__} runs on the CPU)")


def _nvidia_card() -> str:
    """The name of an NVIDIA card, or nothing."""
    try:
        command = ["nvidia-smi", "--query-gpu=name", "--format=csv,noheader"]
        names = subprocess.run(command, capture_output=True, text=True, timeout=20, check=True).stdout
    except (OSError, subprocess.SubprocessError):
        return ""
    return names.strip().splitlines()[0] if names.strip() else ""


def check_jupyter() -> Check:
    """Jupyter would run a notebook on this very Python."""
    if find_spec("ipykernel") is None or find_spec("jupyter_client") is None:
        # Outside a clone the library serves without notebooks.
        return Check("jupyter", False if _in_clone() else None, "ipykernel is not installed",
                     f"run {_SETUP}" if _in_clone() else "pip install 'gvp_lib[notebooks]'")  # fmt: skip
    from jupyter_client.kernelspec import KernelSpecManager

    kernel = KernelSpecManager().get_kernel_spec("python3").argv[0]
    if Path(kernel) == Path(sys.executable) or kernel in {"python", "python3"}:
        return Check("jupyter", True, f"the kernel python3 runs {sys.executable}")
    return Check("jupyter", False, f"the kernel python3 runs {kernel}, not {sys.executable}",
                 f"{sys.executable} -m ipykernel install --sys-prefix")  # fmt: skip


CHECKS: dict[str, Callable[[], Check]] = {
    "python": check_python,
    "packages": check_packages,
    "rendering": check_rendering,
    "port": check_port,
    "disk": check_disk,
    "gpu": check_gpu,
    "jupyter": check_jupyter,
}


def examine(needs: Iterable[str] = ()) -> int:
    """Print a line per need.

    Parameters
    ----------
    needs
        Names of `CHECKS`; all of them where none is given.

    Returns
    -------
    int
        0 if nothing failed, else 1: an exit status.

    Raises
    ------
    UnknownNameError
        For a need that is not one of `CHECKS`.
    """
    needs = list(needs) or list(CHECKS)
    for name in needs:
        if name not in CHECKS:
            raise UnknownNameError("need", name, CHECKS)
    failed = 0
    for name in needs:
        found = CHECKS[name]()
        failed += found.ok is False
        print(found, flush=True)
    return 1 if failed else 0
