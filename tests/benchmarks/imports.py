"""How long ``import gvp_lib`` takes, beyond the start of Python itself. Aim: 0.3 s."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time

REPEATS = 15
AIM = 0.3  # s


def median_time(statement: str) -> float:
    """Median wall time, s, of a fresh Python that runs one statement."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        subprocess.run([sys.executable, "-c", statement], check=True)
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def main() -> None:
    """Print the figures."""
    bare = median_time("pass")
    print(f"bare python: {1e3 * bare:.0f} ms (median of {REPEATS} fresh processes)")
    for statement in ("import gvp_lib", "import gvp_lib.cli", "from gvp_lib import CameraIntrinsics"):
        more = median_time(statement) - bare
        print(f"{statement}: {1e3 * more:.0f} ms more")
        if statement == "import gvp_lib" and more > AIM:
            print(f"  over the aim of {1e3 * AIM:.0f} ms")


if __name__ == "__main__":
    main()
