"""Are the installed packages those that were pinned?"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from importlib import metadata
from typing import TYPE_CHECKING

from gvp_lib.doctor.check import CLONE, SETUP, Check, in_clone

if TYPE_CHECKING:
    from packaging.requirements import Requirement

__all__ = ["check_packages", "locked", "torch_has_cuda"]

_NAMED = 3  # at most so many problems are named in the line


def check_packages() -> Check:
    """In a clone: the packages are those of the lock. Elsewhere: they are in the ranges the package asks for."""
    if in_clone():
        wanted, source, mend = locked(), "environment/lock.txt", f"run {SETUP}"
    else:
        wanted = _that_apply(metadata.requires("gvp_lib") or [])
        source, mend = (
            "this package's own requirements (no clone, so no lock)",
            "install this package anew with pip, which brings what it needs",
        )
    return _judge(wanted, source, mend)


def _judge(wanted: list[Requirement], source: str, mend: str) -> Check:
    wrong = [problem for need in wanted if (problem := _problem(need))]
    if not wrong:
        return Check("packages", True, f"all {len(wanted)} as in {source}")
    more = f" and {len(wrong) - _NAMED} more" if len(wrong) > _NAMED else ""
    named = "; ".join(wrong[:_NAMED]) + more
    return Check("packages", False, f"{len(wrong)} of {len(wanted)} not as in {source}: {named}", mend)


def locked() -> list[Requirement]:
    """What the clone's lock pins for this system, and for CUDA where torch was built for it."""
    files = ["lock.txt", "lock-cuda.txt"] if torch_has_cuda() else ["lock.txt"]
    lines = [line for file in files for line in (CLONE / "environment" / file).read_text("utf-8").splitlines()]
    return _that_apply(line for line in lines if line and not line.lstrip().startswith("#"))


def torch_has_cuda() -> bool:
    """Whether the installed torch was built for CUDA, by its metadata: importing it would take seconds."""
    try:
        needs = metadata.requires("torch") or []
    except metadata.PackageNotFoundError:
        return False
    return any(need.startswith(("nvidia-", "cuda-")) for need in needs)


def _that_apply(lines: Iterable[str]) -> list[Requirement]:
    from packaging.requirements import Requirement

    def needs() -> Iterator[Requirement]:
        for need in map(Requirement, lines):
            if need.marker is None or need.marker.evaluate({"extra": ""}):
                yield need

    return list(needs())


def _problem(need: Requirement) -> str:
    """What is wrong with one package, or nothing."""
    try:
        found = metadata.version(need.name)
    except metadata.PackageNotFoundError:
        return f"{need.name} is missing"
    # `==2.13.0` admits 2.13.0+cpu: another build of the same version.
    return "" if need.specifier.contains(found, prereleases=True) else f"{need.name} is {found}, not {need.specifier}"
