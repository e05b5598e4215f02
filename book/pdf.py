"""Print the whole book as one PDF: what `make pdf` does once a browser is there.

    python book/pdf.py [book/_build/grasp-viewpoint-planning.pdf]

Sphinx makes one page of all chapters from the stored outputs, with a still in the place of each 3D scene, and a
headless Chromium prints it. The first printing tells on which page each chapter begins; it is printed again until what
the contents say is so.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from browser import NoBrowserError, open_browser
from playwright.sync_api import Browser, Page
from pypdf import PdfReader

BOOK = Path(__file__).resolve().parent
PRINTINGS = 4  # at most
FOOTER = """<div style="font: 8px system-ui, sans-serif; color: #6d6457; width: 100%; text-align: center">
<span class="pageNumber"></span></div>"""
# A page of contents before the first chapter. Sphinx marks where each document begins; the mark moves into its section,
# which may begin a page. Documents of the guide and the reference lie within these.
CONTENTS = """() => {
  const marks = [...document.querySelectorAll("span[id^='document-']")];
  const nav = Object.assign(document.createElement("nav"), { className: "contents" });
  nav.append(Object.assign(document.createElement("p"), { textContent: "Contents" }));
  marks[0].before(nav);
  for (const mark of marks) {
    const part = mark.nextElementSibling, title = part.querySelector("h2, h3, h4").textContent.trim();
    const kind = mark.closest("section.chapter") ? "below" : "chapter";
    part.classList.add(kind);
    part.prepend(mark);
    const link = { href: `#${mark.id}`, textContent: title, className: kind };
    nav.append(Object.assign(document.createElement("a"), link));
  }
}"""
PAGES = """(pages) => document.querySelectorAll("nav.contents a").forEach((link) => {
  link.dataset.page = pages[link.getAttribute("href").slice(1)] ?? "000";
})"""


def build_one_page(out: Path, book: Path = BOOK, doctrees: Path = BOOK / "_build" / "doctrees") -> Path:
    """All chapters in one HTML page; a warning is an error, as for the book. What its build has read is kept."""
    options = ["-W", "--keep-going", "-q", "-b", "singlehtml", "-t", "pdf", "-d", str(doctrees)]
    subprocess.run([sys.executable, "-m", "sphinx", *options, str(book), str(out)], check=True)
    return out / "index.html"


def starts(pdf: Path) -> dict[str, int]:
    """By the mark of a document: the page it stands on, from 1."""
    reader = PdfReader(pdf)
    marks = {name: place for name, place in reader.named_destinations.items() if "document-" in name}
    numbers = {name: reader.get_destination_page_number(place) for name, place in marks.items()}
    return {name.removeprefix("/"): number + 1 for name, number in numbers.items() if number is not None}


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


def print_book(html: Path, target: Path, browser: Browser) -> None:
    """Print the one page until its table of contents tells the truth: twice, as a rule.

    Each time from a page that is loaded anew: of one that was printed before, a table may break elsewhere.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    told: dict[str, int] = {}
    for _ in range(PRINTINGS):
        with browser.new_page(offline=True, color_scheme="light") as page:
            page.set_default_timeout(600_000)
            page.goto(html.as_uri())
            page.evaluate("MathJax.startup.promise.then(() => 0)")
            page.evaluate("document.querySelectorAll('details').forEach((folded) => { folded.open = true; })")
            page.evaluate(CONTENTS)
            page.evaluate(PAGES, told)
            print_to(page, target)
        found = starts(target)
        if found == told:
            break
        told = found


def main() -> int:
    """Build, print, and say where it is."""
    target = Path(sys.argv[1] if len(sys.argv) > 1 else BOOK / "_build" / "grasp-viewpoint-planning.pdf").resolve()
    try:
        with open_browser() as browser:
            print_book(build_one_page(BOOK / "_build" / "pdf"), target, browser)
    except NoBrowserError as error:
        print(error, file=sys.stderr)
        return 1
    print(f"The book as a PDF: {target} ({len(PdfReader(target).pages)} pages)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
