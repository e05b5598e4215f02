"""A file of finished jobs that survives whatever ends the run which writes it."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from gvp_lib.errors import JournalError
from gvp_lib.files import open_locked

__all__ = ["Journal"]

_FORMAT = 1


class Journal:
    """One JSON line per finished job, below one that names the recipe; a context, in which it is locked.

    Parameters
    ----------
    path
        The file; it and its folder are made if need be.
    recipe
        JSON data that says what the results depend on. A file of another recipe is refused.
    """

    def __init__(self, path: Path, recipe: Any) -> None:
        self._path = Path(path)
        self._header = json.dumps({"journal": _FORMAT, "recipe": recipe}, sort_keys=True).encode() + b"\n"

    def __enter__(self) -> Journal:
        try:
            self._file = open_locked(self._path)
        except BlockingIOError as error:
            raise JournalError(f"{self._path} is in use by another run; wait for it, or take another path") from error
        return self

    def __exit__(self, *exception: object) -> None:
        self._file.close()

    def read(self) -> dict[str, Any]:
        """The finished values. A last line that was cut short is removed from the file: that job runs again."""
        self._file.seek(0)
        whole, newline, torn = self._file.read().rpartition(b"\n")
        header, *lines = whole.split(b"\n")
        if not newline:  # not even the header is whole: new, or killed at its first write
            if not self._header.startswith(torn):
                raise JournalError(f"{self._path} is not a journal of jobs, and is left as it is; take another path")
            self._file.truncate(0)
            self._write(self._header)
            return {}
        self._compare(header)
        values = {}
        for number, line in enumerate(lines, start=2):
            try:
                entry = json.loads(line)
                values[entry["key"]] = entry["value"]
            except (ValueError, TypeError, KeyError) as error:
                raise JournalError(
                    f"line {number} of {self._path} is damaged: {line[:60]!r}. Remove that line, and its job runs again"
                ) from error
        self._file.truncate(len(whole) + 1)
        return values

    def compare_value(self, key: str, text: str, error: str, value: Any) -> None:
        """Refuse to go on where a job, run again, has another result than the value that the file has."""
        if error or json.loads(text) != value:
            raise JournalError(
                f"{self._path} was begun by other code: its job {key}, run again, "
                + (f"fails:\n{error}" if error else f"has the result\n  {text}\nwhere it had\n  {json.dumps(value)}")
                + "\nGo on with the code that began it, or delete the file to begin anew"
            )

    def append(self, finished: Iterable[tuple[str, str]]) -> None:
        """Add finished jobs, their keys and the JSON texts of their values; on disk when this returns."""
        lines = [f'{{"key": {json.dumps(key)}, "value": {text}}}\n' for key, text in finished]
        if lines:
            self._write("".join(lines).encode())

    def _compare(self, header: bytes) -> None:
        try:
            found = json.loads(header)["recipe"]
        except (ValueError, TypeError, KeyError) as error:
            raise JournalError(f"{self._path} is not a journal of jobs; take another path") from error
        if header + b"\n" != self._header:
            raise JournalError(
                f"{self._path} is the journal of another recipe.\n  its own: {json.dumps(found, sort_keys=True)}\n"
                f"  this run's: {json.dumps(json.loads(self._header)['recipe'], sort_keys=True)}\n"
                "Take another path, or delete the file to begin anew"
            )

    def _write(self, data: bytes) -> None:
        self._file.write(data)
        self._file.flush()
        os.fsync(self._file.fileno())
