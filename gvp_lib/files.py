"""Files that are written whole or not at all."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

__all__ = ["write_file"]


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
