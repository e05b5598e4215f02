"""Links in the Markdown that is read outside of the book, and the form of every address in the project's text."""

import re
from pathlib import Path
from urllib.parse import urlsplit

import pytest

pytestmark = pytest.mark.check

ROOT = Path(__file__).resolve().parents[1]
READ_OUTSIDE = [
    "README.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "environment/README.md",
    "gvp_lib/learning/weights/README.md",
]
TEXT = [
    *(ROOT / name for name in READ_OUTSIDE),
    *sorted((ROOT / "book").glob("*.md")),
    *sorted((ROOT / "book" / "api").glob("*.md")),
    ROOT / "book" / "references.bib",
    ROOT / "book" / "external.py",
    ROOT / "CITATION.cff",
]
ADDRESS = re.compile(r"https?://(?!\.\.\.)[^\s\"'<>)\]}`,]+")  # an ellipsis stands for an address and is none


def anchors(text: str) -> set[str]:
    """As a code host names a document's headings."""
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("name", READ_OUTSIDE)
def test_links_within_the_project_lead_somewhere(name: str) -> None:
    document = ROOT / name
    text = re.sub(r"^```.*?^```", "", document.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if urlsplit(link).scheme:
            continue
        path, _, anchor = link.partition("#")
        target = (document.parent / path).resolve() if path else document
        assert target.exists(), f"{name}: there is no {path}"
        if anchor and target.suffix == ".md":
            assert anchor in anchors(target.read_text("utf-8")), f"{name}: {target.name} has no heading for #{anchor}"


def addresses() -> dict[str, set[str]]:
    """Every address, and the files it stands in."""
    found: dict[str, set[str]] = {}
    for path in TEXT:
        for address in ADDRESS.findall(path.read_text("utf-8")):
            found.setdefault(address.rstrip(".;:"), set()).add(path.name)
    return found


def test_addresses_are_secure_and_whole() -> None:
    assert len(addresses()) > 10
    for address, files in addresses().items():
        parts = urlsplit(address)
        local = parts.hostname in {"127.0.0.1", "localhost"}
        assert parts.scheme == "https" or local, f"{address} in {files}"
        assert local or "." in (parts.hostname or ""), f"{address} in {files}"


def test_one_place_has_one_spelling() -> None:
    spellings: dict[tuple[str, str], set[str]] = {}
    for address in addresses():
        parts = urlsplit(address)
        place = (parts.netloc.lower().removeprefix("www."), parts.path.rstrip("/").lower() + "#" + parts.fragment)
        spellings.setdefault(place, set()).add(address)
    assert {place: found for place, found in spellings.items() if len(found) > 1} == {}
