"""A reader of the book: opens a page in a browser, and notes what goes wrong and what keeps readers out; looks at a 3D
scene, and sees whether it draws and whether it plays."""

import time
from pathlib import Path

import axe_playwright_python
import cv2
import numpy as np

AXE = (Path(axe_playwright_python.__file__).parent / "axe.min.js").read_text("utf-8")
WIDE, PHONE = {"width": 1400, "height": 1000}, {"width": 390, "height": 844}
PATIENCE = 120_000  # ms; a busy machine is no failure


class Watched:
    """A page, opened without a network. Leaving it fails where something is ``wrong``: an error of any frame, a request
    to anywhere."""

    def __init__(self, browser, **context):
        self.context = browser.new_context(offline=True, **context)
        self.context.set_default_timeout(PATIENCE)
        self.page = self.context.new_page()
        self.wrong: list[str] = []
        self.context.on("request", self._requested)
        self.context.on("weberror", lambda error: self.wrong.append(f"page error: {error.error}"))
        self.context.on("console", lambda said: said.type == "error" and self.wrong.append(f"console: {said.text}"))
        self.context.on("requestfailed", lambda request: self.wrong.append(f"failed: {request.url}"))

    def _requested(self, request) -> None:
        if not request.url.startswith(("file:", "data:", "blob:", "about:")):
            self.wrong.append(f"asked a network: {request.url}")

    def open(self, path: Path) -> None:
        self.page.goto(path.as_uri())
        self.page.evaluate("window.MathJax?.startup?.promise.then(() => 0)")

    def __enter__(self):
        return self

    def __exit__(self, error, *_):
        self.context.close()
        assert error or self.wrong == []


STICKING_OUT = """() => {
  const page = document.documentElement, wide = page.clientWidth;
  if (page.scrollWidth <= wide) return [];
  const outer = (e) => e.getBoundingClientRect().right > wide + 1;
  return [`${page.scrollWidth} px on ${wide}`, ...[...document.querySelectorAll(".bd-main *")].filter(outer)
    .filter((e) => ![...e.children].some(outer)).map((e) => e.outerHTML.slice(0, 90))];
}"""
RAW_TEX = """() => {
  const copy = document.querySelector("main").cloneNode(true);
  copy.querySelectorAll("pre, code, script, mjx-container").forEach((e) => e.remove());
  return copy.textContent.match(/\\\\[(\\[]|\\$\\$|\\\\(begin|frac|mathbf|operatorname)\\b.{0,40}/g) ?? [];
}"""
BROKEN_IMAGES = """() => Promise.all([...document.images].map((image) => {
  image.loading = "eager";
  return image.decode().then(() => "", () => image.src);
})).then((all) => all.filter(Boolean))"""
# Contrast is a matter of color, size and ground: of text that is alike in all of them, the smallest piece is looked at,
# once in the whole book. A page has thousands, and each costs a millisecond. Marks what is new, and returns its styles.
MARK_NEW_STYLES = """(known) => {
  const grounds = new Map([[null, ""]]);
  const ground = (e) => {
    if (!grounds.has(e)) {
      const { backgroundColor, backgroundImage, opacity } = getComputedStyle(e);
      const own = [backgroundColor, backgroundImage, opacity].join(), bare = "rgba(0, 0, 0, 0),none,1";
      grounds.set(e, (own === bare ? "" : `${own};`) + ground(e.parentElement));
    }
    return grounds.get(e);
  };
  const size = (e) => e.getElementsByTagName("*").length;
  const alike = new Map(), texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const piece = texts.currentNode.parentElement, blank = !texts.currentNode.data.trim();
    if (blank || piece.closest("script, style, noscript") || !piece.checkVisibility()) continue;
    const { color, fontSize, fontWeight, textDecorationLine } = getComputedStyle(piece), link = piece.closest("a");
    const around = link && getComputedStyle(link.parentElement).color;
    const style = [color, fontSize, fontWeight, textDecorationLine, around, ground(piece)].join();
    if (!alike.has(style) || size(piece) < size(alike.get(style))) alike.set(style, piece);
  }
  known.forEach((style) => alike.delete(style));
  document.querySelectorAll("[data-new]").forEach((e) => e.removeAttribute("data-new"));
  alike.forEach((piece) => [piece, ...piece.querySelectorAll("*")].forEach((e) => e.setAttribute("data-new", "")));
  return [...alike.keys()];
}"""
# Violations that are serious or critical. Rules of color look at what is marked; "region" is moderate, and slow.
SERIOUS = """async ({ only, without }) => {
  axe.configure({ rules: [
    { id: "color-contrast", selector: "[data-new]" },
    { id: "link-in-text-block", selector: "a[href][data-new], [role=link][data-new]" },
  ] });
  const options = { iframes: false, preload: false, resultTypes: ["violations"] };
  if (only) options.runOnly = only;
  if (without) options.rules = Object.fromEntries(without.map((rule) => [rule, { enabled: false }]));
  const found = (await axe.run(document, options)).violations;
  return found.filter((v) => ["serious", "critical"].includes(v.impact)).flatMap((v) => v.nodes.map((n) =>
    `${v.id}: ${n.html.slice(0, 120)} (${(n.any[0] ?? n.all[0] ?? n.none[0]).message})`));
}"""
OF_COLOR = ["color-contrast", "link-in-text-block"]
TURN = """async (theme) => {
  document.documentElement.dataset.theme = theme;
  const fading = document.getAnimations().filter((each) => each instanceof CSSTransition);
  await Promise.allSettled(fading.map((each) => each.finished));
}"""
SCENES = "**/generated/scenes/*.html"
BLANK = "<!doctype html><title>a scene</title>"


class Reader:
    """Reads page after page in one tab; a style of text that it has looked at it knows again."""

    def __init__(self, watched: Watched) -> None:
        self.watched, self.page = watched, watched.page
        self.known: list[str] = []
        self.formulas = 0
        watched.context.route(SCENES, lambda route: route.fulfill(body=BLANK, content_type="text/html"))

    def visit(self, path: Path) -> dict[str, list[str]]:
        """What is wrong on a page, by the fault. Scenes stay empty: test_scenes.py has them.

        What keeps a reader out are axe-core's serious and critical findings: contrast, names, roles, order.
        """
        page, found = self.page, {"errs or asks a network": []}
        self.watched.wrong = found["errs or asks a network"]
        page.set_viewport_size(WIDE)
        self.watched.open(path)
        formulas = page.locator(".math").count()
        self.formulas += formulas
        unset = formulas - page.locator(".math > mjx-container, .math .mjx-container").count()
        found["leaves a formula raw"] = page.evaluate(RAW_TEX) + [f"{unset} formulas"] * (unset > 0)
        found["lacks a picture"] = page.evaluate(BROKEN_IMAGES)
        found["scrolls sideways"] = page.evaluate(STICKING_OUT)
        page.evaluate(AXE + ";0")
        found["keeps a reader out"] = page.evaluate(SERIOUS, {"without": [*OF_COLOR, "region"]}) + self.of_color()
        page.evaluate(TURN, "dark")
        found["keeps a reader out in the dark"] = self.of_color()
        page.set_viewport_size(PHONE)
        found["scrolls sideways on a phone"] = page.evaluate(STICKING_OUT)
        found["keeps a reader out on a phone"] = self.of_a_phone()
        return {fault: what for fault, what in found.items() if what}

    def of_color(self) -> list[str]:
        """What axe-core says of the color of texts whose style was not met before."""
        styles = self.page.evaluate(MARK_NEW_STYLES, self.known)
        self.known += styles
        return self.page.evaluate(SERIOUS, {"only": OF_COLOR}) if styles else []

    def of_a_phone(self) -> list[str]:
        """What can't be scrolled by a keyboard there. The theme mends that a moment after a page has become narrow."""
        limit = time.monotonic() + PATIENCE / 4_000
        while found := self.page.evaluate(SERIOUS, {"only": ["scrollable-region-focusable", "meta-viewport"]}):
            if time.monotonic() > limit:
                break
            self.page.wait_for_timeout(300)
        return found


# --- 3D scenes --------------------------------------------------------------------------------------------------------

TO = """(bar, share) => {
  bar.value = Number(bar.min) + share * (Number(bar.max) - Number(bar.min));
  bar.dispatchEvent(new Event("input", { bubbles: true }));
}"""
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
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR_RGB)


def differing(a: np.ndarray, b: np.ndarray) -> float:
    """The fraction of pixels that differ visibly."""
    return float(np.mean(np.abs(a.astype(int) - b).max(axis=-1) > 8))


def until(look, good, complaint: str):
    """The first of several looks that is good."""
    limit = time.monotonic() + PATIENCE / 1000
    while not good(seen := look()):
        assert time.monotonic() < limit, complaint
        time.sleep(0.1)
    return seen


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
    """Playing goes on, and what there is to be seen later is not what was there before.

    It pauses as soon as it has gone on, and is then taken to later moments, since many a recording begins at rest: each
    picture of a scene at play costs a processor a second.
    """
    before = frame.locator("#scrub").input_value()
    frame.locator("#play").click()
    frame.wait_for_function(PAUSE_ONCE_MOVED, arg=before)
    later = iter((0.5, 0.8, 0.3, 1.0, 0.65) * 9)

    def seen_later() -> np.ndarray:
        frame.locator("#scrub").evaluate(TO, next(later))
        return picture(page, box)

    until(seen_later, lambda seen: differing(seen, first) > 1e-3, f"{name}: nothing moves")
