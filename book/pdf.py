"""Print the whole book as one PDF: what `make pdf` does once a browser is there.

    python book/pdf.py [book/_build/grasp-viewpoint-planning.pdf]

Sphinx makes one page of all chapters from the stored outputs, with a still in the place of each 3D scene, and a headless
Chromium prints it. It is printed twice: the first printing tells on which page each chapter begins.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from browser import NoBrowserError, open_browser
from playwright.sync_api import Page
from pypdf import PdfReader
from pypdf.generic import Destination

BOOK = Path(__file__).resolve().parent
FOOTER = """<div style="font: 8px system-ui, sans-serif; color: #6d6457; width: 100%; text-align: center">
<span class="pageNumber"></span></div>"""
# A contents page behind the first one: chapters, and their sections.
CONTENTS = """(pages) => {
  document.querySelector("nav.contents")?.remove();
  const chapters = [...document.querySelectorAll("div.body section")].filter((s) => s.querySelector(":scope > h1"));
  chapters.slice(1).forEach((chapter) => chapter.classList.add("chapter"));
  const list = (sections) => {
    const ol = document.createElement("ol");
    for (const section of sections) {
      const heading = section.querySelector(":scope > :is(h1, h2)"), li = document.createElement("li");
      const a = Object.assign(document.createElement("a"), { href: `#${section.id}`, textContent: heading.textContent });
      a.dataset.page = pages[heading.textContent.trim()] ?? "";
      li.append(a);
      ol.append(li);
    }
    return ol;
  };
  const nav = Object.assign(document.createElement("nav"), { className: "contents" });
  nav.append(Object.assign(document.createElement("div"), { innerHTML: "<b>Contents</b>" }), list(chapters.slice(1)));
  chapters[1].before(nav);
}"""


def build_one_page(out: Path) -> Path:
    """All chapters in one HTML page; a warning is an error, as for the book."""
    options = ["-W", "--keep-going", "-q", "-b", "singlehtml", "-t", "pdf"]
    subprocess.run([sys.executable, "-m", "sphinx", *options, str(BOOK), str(out)], check=True)
    return out / "index.html"


def starts(pdf: Path) -> dict[str, int]:
    """By heading: the page it stands on, from 1."""
    reader = PdfReader(pdf)
    found: dict[str, int] = {}

    def walk(entries: list) -> None:
        for entry in entries:
            if isinstance(entry, Destination):
                page = reader.get_destination_page_number(entry)
                found.setdefault(str(entry.title).strip(), page + 1 if page is not None else 0)
            else:
                walk(entry)

    walk(reader.outline)
    return found


def print_to(page: Page, target: Path) -> None:
    """One printing, with page numbers and an outline."""
    page.pdf(
        path=target,
        prefer_css_page_size=True,
        print_background=True,
        display_header_footer=True,
        header_template="<span></span>",
        footer_template=FOOTER,
        outline=True,
        tagged=True,
    )


def print_book(html: Path, target: Path) -> None:
    """Print the one page, first without, then with the pages in its table of contents."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with open_browser() as browser:
        page = browser.new_page(offline=True, color_scheme="light")
        page.set_default_timeout(600_000)
        page.goto(html.as_uri())
        page.evaluate("MathJax.startup.promise.then(() => 0)")
        page.evaluate(CONTENTS, {})
        print_to(page, target)
        page.evaluate(CONTENTS, starts(target))
        print_to(page, target)


def main() -> int:
    """Build, print, and say where it is."""
    target = Path(sys.argv[1] if len(sys.argv) > 1 else BOOK / "_build" / "grasp-viewpoint-planning.pdf").resolve()
    try:
        print_book(build_one_page(BOOK / "_build" / "pdf"), target)
    except NoBrowserError as error:
        print(error, file=sys.stderr)
        return 1
    print(f"The book as a PDF: {target} ({len(PdfReader(target).pages)} pages)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
