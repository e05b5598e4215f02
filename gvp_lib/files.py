"""Files that are written whole or not at all, and files that are one process's alone."""

from __future__ import annotations

import fcntl
import os
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

__all__ = ["open_locked", "write_file"]


def write_file(path: Path | str, data: bytes) -> None:
    """Write a file whole or not at all: a reader never finds half of it. Its folder is made if need be.

    Only one process may write it at a time. A draft that one left when it was killed is the next one's.

    Raises
    ------
    OSError
        It cannot be written; what was there before is still there.
    """
    path = Path(path)
    draft = path.with_name(f".{path.name}.draft")  # beside it, so that the renaming is atomic
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(draft, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    except OSError:
        with suppress(OSError):
            draft.unlink()
        raise


def open_locked(path: Path | str) -> BinaryIO:
    """Open a file to read and to append, for this process alone until it is closed or the process ends.

    It and its folder are made if need be.

    Raises
    ------
    BlockingIOError
        Another process has it.
    OSError
        It cannot be opened for writing.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    file = open(path, "a+b")  # noqa: SIM115 - the caller closes it
    try:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:  # of several kinds, by the file system
        file.close()
        raise BlockingIOError(error.errno, error.strerror, str(path)) from error
    return file
