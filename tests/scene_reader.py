"""A reader of the book's 3D scenes: sees whether one draws, and whether it plays."""

import time

import cv2
import numpy as np

PATIENCE = 120_000  # ms; a busy machine is no failure
PAUSE_ONCE_MOVED = """(before) => {
  const moved = document.querySelector("#scrub").value !== before;
  if (moved) document.querySelector("#play").click();
  return moved;
}"""
BAR, CORNER = 60, 52  # px below, where the play bar is; px at the right, where the reset button is


def picture(page, box) -> np.ndarray:
    """What is on the screen in a scene's ``box``, without its controls, which move too: RGB (h, w, 3)."""
    clip = {"x": box["x"], "y": box["y"], "width": box["width"] - CORNER, "height": box["height"] - BAR}
    png = page.screenshot(clip=clip, animations="allow")
    return cv2.cvtColor(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)


def differing(a: np.ndarray, b: np.ndarray) -> float:
    """The fraction of pixels that differ visibly."""
    return float(np.mean(np.abs(a.astype(int) - b).max(axis=-1) > 8))


def check_that_it_draws(page, frame, box, name: str) -> np.ndarray:
    """Drawn: not what is there without the canvas."""
    canvas = frame.locator("#view canvas")
    canvas.wait_for()
    canvas.evaluate("(canvas) => { canvas.style.visibility = 'hidden'; }")
    empty = picture(page, box)
    canvas.evaluate("(canvas) => { canvas.style.visibility = ''; }")
    first = until(lambda: picture(page, box), lambda seen: differing(seen, empty) > 0.1, f"{name}: nothing is drawn")
    # Readable: what is drawn stands out from what is behind it, from dark to bright.
    drawn = first[np.abs(first.astype(int) - empty).max(axis=-1) > 8] @ (0.21, 0.72, 0.07)
    assert np.percentile(drawn, 98) - np.percentile(drawn, 2) > 60, f"{name}: all of one brightness"
    return first


def check_that_it_plays(page, frame, box, first: np.ndarray, name: str) -> None:
    """Playing: not what was there before. It pauses as soon as it has moved, and is looked at then: each picture of a
    scene at play costs a processor a second."""
    until(lambda: play_on(page, frame, box), lambda seen: differing(seen, first) > 1e-3, f"{name}: nothing moves")


def play_on(page, frame, box) -> np.ndarray:
    """The picture in which a scene pauses that has played for a moment."""
    before = frame.locator("#scrub").input_value()
    frame.locator("#play").click()
    frame.wait_for_function(PAUSE_ONCE_MOVED, arg=before)
    return picture(page, box)


def until(look, good, complaint):
    """The first of several looks that is good."""
    limit = time.monotonic() + PATIENCE / 1000
    while not good(seen := look()):
        assert time.monotonic() < limit, complaint
        time.sleep(0.1)
    return seen
