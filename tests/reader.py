"""A reader of the book: opens a page in a browser, and notes what goes wrong and what keeps readers out."""

import time
from dataclasses import dataclass, field
from pathlib import Path

import axe_playwright_python

AXE = (Path(axe_playwright_python.__file__).parent / "axe.min.js").read_text("utf-8")
WIDE, PHONE = {"width": 1400, "height": 1000}, {"width": 390, "height": 844}
PATIENCE = 120_000  # ms; a busy machine is no failure


class Watched:
    """A page, opened without a network, and what went wrong on it: errors of any frame, requests to anywhere."""

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

    def __exit__(self, *_):
        self.context.close()


@dataclass
class Visit:
    """What a browser found on one page."""

    wrong: list[str] = field(default_factory=list)  # errors and requests
    too_wide: dict[str, list[str]] = field(default_factory=dict)  # by width: what sticks out
    violations: dict[str, list[str]] = field(default_factory=dict)  # by light or dark: what axe-core says
    formulas: int = 0  # in the page's source
    typeset: int = 0
    raw_tex: list[str] = field(default_factory=list)
    broken_images: list[str] = field(default_factory=list)


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
# Contrast is a matter of color, size and ground: of text that is alike in all of them, the smallest piece is looked at.
# A page has thousands, and each costs a millisecond.
ONE_OF_EACH_STYLE = """(() => {
  const grounds = (e) => { const all = []; for (; e; e = e.parentElement) {
    const { backgroundColor, backgroundImage, opacity } = getComputedStyle(e);
    if (backgroundColor !== "rgba(0, 0, 0, 0)" || backgroundImage !== "none" || opacity !== "1")
      all.push(backgroundColor, backgroundImage, opacity);
  } return all; };
  const alike = new Map(), texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const piece = texts.currentNode.parentElement, blank = !texts.currentNode.data.trim();
    if (blank || piece.closest("script, style, noscript") || !piece.checkVisibility()) continue;
    const { color, fontSize, fontWeight, textDecorationLine } = getComputedStyle(piece);
    const own = [color, fontSize, fontWeight, textDecorationLine, piece.closest("a") && "a"];
    const style = [...own, ...grounds(piece)].join();
    const size = (e) => e.getElementsByTagName("*").length;
    if (!alike.has(style) || size(piece) < size(alike.get(style))) alike.set(style, piece);
  }
  return [...alike.values()];
})()"""
SERIOUS = """async ({ only, without, where }) => {
  const options = { iframes: false, preload: false, resultTypes: ["violations"] };
  if (only) options.runOnly = only;
  if (without) options.rules = Object.fromEntries(without.map((rule) => [rule, { enabled: false }]));
  const found = (await axe.run(where ? { include: eval(where) } : document, options)).violations;
  return found.filter((v) => ["serious", "critical"].includes(v.impact)).flatMap((v) => v.nodes.map((n) =>
    `${v.id}: ${n.html.slice(0, 120)} (${(n.any[0] ?? n.all[0] ?? n.none[0]).message})`));
}"""
OF_COLOR = ["color-contrast", "link-in-text-block"]


def visit(browser, path: Path) -> Visit:
    """One page, wide and on a phone, light and dark. Its scenes stay empty: test_scenes.py opens them."""
    with Watched(browser, viewport=WIDE, reduced_motion="reduce", color_scheme="light") as watched:
        blank = {"body": "<!doctype html><title>a scene</title>", "content_type": "text/html"}
        watched.context.route("**/generated/scenes/*.html", lambda route: route.fulfill(**blank))
        watched.open(path)
        page, found = watched.page, Visit(wrong=watched.wrong)
        found.formulas = page.locator(".math").count()
        found.typeset = page.locator(".math > mjx-container, .math .mjx-container").count()
        found.raw_tex = page.evaluate(RAW_TEX)
        found.broken_images = page.evaluate(BROKEN_IMAGES)
        found.too_wide["wide"] = page.evaluate(STICKING_OUT)
        page.set_viewport_size(PHONE)
        found.too_wide["phone"] = page.evaluate(STICKING_OUT)
        page.evaluate(AXE + ";0")
        found.violations["phone"] = of_a_phone(page)
        page.set_viewport_size(WIDE)
        colors = {"only": OF_COLOR, "where": ONE_OF_EACH_STYLE}
        found.violations["light"] = page.evaluate(SERIOUS, {"without": OF_COLOR}) + page.evaluate(SERIOUS, colors)
        page.evaluate("document.documentElement.dataset.theme = 'dark'")
        found.violations["dark"] = page.evaluate(SERIOUS, colors)
    return found


def of_a_phone(page) -> list[str]:
    """What can't be scrolled by a keyboard there. The theme mends that a moment after a page has become narrow."""
    limit = time.monotonic() + PATIENCE / 4_000
    while found := page.evaluate(SERIOUS, {"only": ["scrollable-region-focusable", "meta-viewport"]}):
        if time.monotonic() > limit:
            break
        page.wait_for_timeout(300)
    return found
