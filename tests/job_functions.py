"""Jobs, and functions that workers of other processes can import."""

import json
import os
import time

import numpy as np

JOBS = {f"job {n}": n for n in range(12)}


def as_text(results):
    """With every digit, and equal where both are NaN."""
    return json.dumps({key: result.value for key, result in results.items()})


def draw(seed):
    """Some random numbers, one of which no decimal fraction of few digits holds."""
    return {"x": list(np.random.default_rng(seed).normal(size=3)), "third": seed / 3, "nothing": float("nan")}


def slow_draw(seed):
    time.sleep(0.02)
    return draw(seed)


def counted_pid(notes):
    """This process; leaves a byte in a file for each time that it has run."""
    with open(notes, "ab", buffering=0) as file:
        file.write(b"x")
    return os.getpid()


def as_bytes(n):
    return bytes([n, 255])


def fail_on_three(n):
    if n == 3:
        raise ValueError("three is too many")
    return n


def die_on_three(n):
    if n == 3:
        os._exit(9)
    return n
