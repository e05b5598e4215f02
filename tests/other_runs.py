"""Another process that has a file to itself, for tests of what refuses to share it."""

import subprocess
import sys
from contextlib import contextmanager

_HOLDS = """
import sys
from gvp_lib.jobs import open_locked
with open_locked(sys.argv[1]):
    print("held", flush=True)
    sys.stdin.read()
"""


@contextmanager
def held_by_another_run(path):
    """Lock a file in another process for as long as the context lasts."""
    command = [sys.executable, "-c", _HOLDS, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout.readline() == b"held\n"
        try:
            yield
        finally:
            other.stdin.close()
