"""The 3D scenes as a reader meets them: each draws and plays, alone and in its page, light and dark."""

import base64
import gzip
import json
import re
import time
from pathlib import Path

import cv2
import nbformat
import numpy as np
import pytest
from reader import PATIENCE, PHONE, Watched

from gvp_lib.views.page import SCENE_MIME

ROOT = Path(__file__).parents[2]
CHAPTERS = sorted((ROOT / "notebooks").glob("*.ipynb"))
SMALL = {"width": 300, "height": 260}  # a processor draws these scenes here: few pixels
BAR, CORNER = 60, 52  # px below, where the play bar is; px at the right, where the reset button is


def picture(page, box) -> np.ndarray:
    """What is on the screen in a scene's ``box``, without its controls, which move too: RGB (h, w, 3)."""
    clip = {"x": box["x"], "y": box["y"], "width": box["width"] - CORNER, "height": box["height"] - BAR}
    png = page.screenshot(clip=clip, animations="allow")
    return cv2.cvtColor(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)


def differing(a: np.ndarray, b: np.ndarray) -> float:
    """The fraction of pixels that differ visibly."""
    return float(np.mean(np.abs(a.astype(int) - b).max(axis=-1) > 8))


def check_that_it_draws(page, frame, box) -> np.ndarray:
    """Drawn: not what is there without the canvas."""
    canvas = frame.locator("#view canvas")
    canvas.wait_for()
    canvas.evaluate("(canvas) => { canvas.style.visibility = 'hidden'; }")
    empty = picture(page, box)
    canvas.evaluate("(canvas) => { canvas.style.visibility = ''; }")
    first = until(lambda: picture(page, box), lambda seen: differing(seen, empty) > 0.1, "nothing is drawn")
    # Readable: what is drawn stands out from what is behind it, from dark to bright.
    drawn = first[np.abs(first.astype(int) - empty).max(axis=-1) > 8] @ (0.21, 0.72, 0.07)
    assert np.percentile(drawn, 98) - np.percentile(drawn, 2) > 60, "all of one brightness"
    return first


def check_that_it_plays(page, frame, box, first: np.ndarray) -> None:
    """Playing: not what was there before. It is looked at while it pauses: each picture of a scene at play costs a
    processor a second."""

    def play_on() -> np.ndarray:
        before = frame.locator("#scrub").input_value()
        frame.locator("#play").click()
        frame.wait_for_function("(before) => document.querySelector('#scrub').value !== before", arg=before)
        frame.locator("#play").click()
        return picture(page, box)

    until(play_on, lambda seen: differing(seen, first) > 1e-3, "nothing moves")


def until(look, good, complaint):
    """The first of several looks that is good."""
    limit = time.monotonic() + PATIENCE / 1000
    while not good(seen := look()):
        assert time.monotonic() < limit, complaint
        time.sleep(0.1)
    return seen


def test_every_scene_draws_and_plays(browser, scenes):
    """Each alone, as its frame in a page shows it; half of them dark."""
    assert len(scenes) > len(CHAPTERS)
    for number, scene in enumerate(scenes):
        scheme = ("light", "dark")[number % 2]
        with Watched(browser, viewport=SMALL, color_scheme=scheme, reduced_motion="reduce") as watched:
            watched.open(scene)
            page, box = watched.page, {"x": 0, "y": 0, **SMALL}
            first = check_that_it_draws(page, page.main_frame, box)
            if page.locator("#bar").is_visible():
                check_that_it_plays(page, page.main_frame, box, first)
            assert watched.wrong == [], scene.name


def test_every_scene_has_a_lazy_frame_in_its_chapter(html, scenes):
    """By its attribute: the browser that Playwright drives is told to load every frame at once."""
    for scene in scenes:
        chapter, _, number = scene.stem.rpartition("-")
        frames = re.findall(
            r'<iframe src="([^"]+)" title="[^"]+" loading="lazy"',
            (html / "notebooks" / f"{chapter}.html").read_text("utf-8"),
        )
        assert (html / "notebooks" / frames[int(number) - 1]).resolve() == scene.resolve()


def test_the_first_page_has_a_scene_that_plays_by_itself_where_it_stands(browser, html):
    with Watched(browser, viewport=PHONE, color_scheme="dark") as watched:
        watched.open(html / "index.html")
        place = watched.page.locator(".gvp-scene")
        place.evaluate("(scene) => scene.scrollIntoView({ block: 'center', behavior: 'instant' })")
        frame = place.locator("iframe").element_handle().content_frame()
        frame.locator(":root.dark #view canvas").wait_for()
        box = place.bounding_box()
        first = check_that_it_draws(watched.page, frame, box)
        until(lambda: picture(watched.page, box), lambda seen: differing(seen, first) > 1e-3, "nothing moves")
        assert watched.wrong == []


def test_a_scene_stops_where_the_reader_scrubs_it_to(browser, html):
    with Watched(browser, viewport=SMALL) as watched:
        watched.open(html / "_static" / "generated" / "scenes" / "02_sphere_traversal-2.html")
        page, box = watched.page, {"x": 0, "y": 0, **SMALL}
        page.locator("#scrub").fill("0")
        start = picture(page, box)
        page.locator("#scrub").fill(str(float(page.locator("#scrub").get_attribute("max")) / 2))
        there = until(lambda: picture(page, box), lambda seen: differing(seen, start) > 1e-3, "it cannot be scrubbed")
        now, duration = page.locator("#time").inner_text().removesuffix(" s").split(" / ")
        assert float(now) == pytest.approx(float(duration) / 2, abs=0.11)
        assert page.locator("#play").get_attribute("aria-label") == "Play"
        time.sleep(0.5)
        assert differing(picture(page, box), there) < 1e-3, "it went on"


def test_a_page_that_turns_light_tells_its_scenes(browser, html):
    with Watched(browser, viewport=SMALL, color_scheme="dark", reduced_motion="reduce") as watched:
        watched.open(html / "notebooks" / "98_of_a_test.html")
        frame = watched.page.locator(".gvp-scene iframe").element_handle().content_frame()
        frame.locator(":root.dark").wait_for()
        watched.page.evaluate("document.documentElement.dataset.theme = 'light'")
        frame.locator(":root:not(.dark)").wait_for()


@pytest.mark.parametrize("path", CHAPTERS, ids=lambda path: path.stem)
def test_every_chapter_has_a_recorded_scene_and_a_picture_where_no_script_runs(path):
    notebook = nbformat.read(path, as_version=4)
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ()) if "data" in output]
    views = [output.data for output in outputs if SCENE_MIME in output.data]
    recorded = [view for view in views if "animation" in unpacked(view)]
    assert recorded, "no scene of this chapter moves"
    for view in views:
        assert view["image/png"], "a code host shows a picture"
        assert "3D view" in view["text/plain"]


def unpacked(view) -> dict:
    return json.loads(gzip.decompress(base64.b64decode(view[SCENE_MIME]["scene"])))
