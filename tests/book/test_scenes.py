"""The 3D scenes as a reader meets them: each draws and plays, alone and in its page, light and dark."""

import time

import mujoco
import numpy as np
import pytest
from reader import PHONE, Watched, check_that_it_draws, check_that_it_plays, differing, picture, until

from gvp_lib.views.scene3d import Scene3D

pytestmark = pytest.mark.full
SMALL = {"width": 300, "height": 260}  # a processor draws these scenes here: few pixels


def test_every_scene_draws_and_plays(browser, scenes):
    """Each alone, as its frame in a page shows it, one after the other in one tab; every other one dark."""
    assert len(scenes) > 20
    with Watched(browser, viewport=SMALL) as watched:
        page, box = watched.page, {"x": 0, "y": 0, **SMALL}
        for number, scene in enumerate(scenes):
            page.emulate_media(color_scheme=("light", "dark")[number % 2], reduced_motion="reduce")
            watched.open(scene)
            first = check_that_it_draws(page, page.main_frame, box, scene.name)
            if page.locator("#bar").is_visible():
                check_that_it_plays(page, page.main_frame, box, first, scene.name)
            assert watched.wrong == [], scene.name


def test_a_saved_page_that_is_sent_alone_draws(browser, tmp_path):
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='.1'/></worldbody></mujoco>")
    page = Scene3D(model, title="a ball").show().save(tmp_path / "folder" / "ball.html").rename(tmp_path / "sent.html")
    with Watched(browser, viewport=SMALL) as watched:
        watched.open(page)
        check_that_it_draws(watched.page, watched.page.main_frame, {"x": 0, "y": 0, **SMALL}, "a saved page")


def test_the_first_page_has_a_scene_that_plays_by_itself_where_it_stands(browser, html):
    with Watched(browser, viewport=PHONE, color_scheme="dark") as watched:
        watched.open(html / "index.html")
        place = watched.page.locator(".gvp-scene")
        place.evaluate("(scene) => scene.scrollIntoView({ block: 'center', behavior: 'instant' })")
        frame = place.locator("iframe").element_handle().content_frame()
        frame.locator(":root.dark #view canvas").wait_for()
        box = place.bounding_box()
        first = check_that_it_draws(watched.page, frame, box, "the first page's")
        until(lambda: picture(watched.page, box), lambda seen: differing(seen, first) > 1e-3, "nothing moves")


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


SIGHT = "gvpScene.camera.position.clone().sub(gvpScene.controls.target).normalize().toArray()"


def swipe(page, x: float, y: float, across: float, down: float) -> None:
    """One finger on a touch screen, as the screen reports it."""
    screen = page.context.new_cdp_session(page)
    for share in np.linspace(0, 1, 12):
        kind = "touchMove" if share else "touchStart"
        finger = {"x": x + share * across, "y": y + share * down}
        screen.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [finger]})
    screen.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


def test_on_a_telephone_a_swipe_scrolls_the_page_until_a_tap_takes_hold_of_the_scene(browser, html):
    with Watched(browser, viewport=PHONE, has_touch=True, is_mobile=True, reduced_motion="reduce") as watched:
        watched.open(html / "notebooks" / "98_of_a_test.html")
        page, place = watched.page, watched.page.locator(".gvp-scene")
        frame = place.locator("iframe").element_handle().content_frame()
        frame.locator("#view canvas").wait_for()
        bar = frame.locator("#scrub")

        def after(gesture) -> tuple[float, float]:
            """How far a gesture in the middle of the scene scrolls the page, px, and turns the scene, deg."""
            place.evaluate("(scene) => scene.scrollIntoView({ block: 'center', behavior: 'instant' })")
            page.wait_for_timeout(300)
            box, top = place.bounding_box(), page.evaluate("scrollY")
            before = frame.evaluate(SIGHT)
            gesture(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
            page.wait_for_timeout(700)
            turned = np.arccos(np.clip(np.dot(before, frame.evaluate(SIGHT)), -1, 1))
            return page.evaluate("scrollY") - top, np.degrees(turned)

        def swiped() -> tuple[float, float]:
            return after(lambda x, y: swipe(page, x, y, 40, -120))

        def dragged(x: float, y: float) -> None:
            page.mouse.move(x, y)
            page.mouse.down()
            page.mouse.move(x + 40, y - 60, steps=5)
            page.mouse.up()

        stays, turns = pytest.approx(0, abs=0.5), pytest.approx(90, abs=80)
        scrolls = pytest.approx(110, abs=25)  # what the finger moves, less what tells a swipe from a tap
        assert swiped() == (scrolls, stays)
        assert after(lambda x, _: swipe(page, x, bar.bounding_box()["y"] + 20, 0, -120)) == (scrolls, stays)
        assert after(dragged) == (stays, turns), "a mouse needs no tap"
        assert after(page.touchscreen.tap) == (stays, stays)
        assert swiped() == (stays, turns)
        box = place.bounding_box()
        page.touchscreen.tap(box["x"] + 5, box["y"] - 15)
        assert swiped() == (scrolls, stays), "a tap beside it lets go"
