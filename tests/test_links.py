"""Links in the Markdown that is read outside of the book, and the form of every address in the project's text."""

import re
from urllib.parse import urlsplit

import pytest
from snippets import ROOT

pytestmark = pytest.mark.check

READ_OUTSIDE = [
    "README.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "environment/README.md",
    "gvp_lib/learning/weights/README.md",
]
TEXT = [*READ_OUTSIDE, "book/references.bib", "book/external.py", "CITATION.cff"]
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


def test_addresses_are_secure_and_whole_and_one_place_has_one_spelling() -> None:
    pages = [*(ROOT / name for name in TEXT), *(ROOT / "book").glob("*.md"), *(ROOT / "book" / "api").glob("*.md")]
    found = {address.rstrip(".;:") for page in pages for address in ADDRESS.findall(page.read_text("utf-8"))}
    assert len(found) > 10
    spellings: dict[str, str] = {}
    for address in sorted(found):
        parts = urlsplit(address)
        if parts.hostname not in {"127.0.0.1", "localhost"}:
            assert parts.scheme == "https", address
            assert "." in (parts.hostname or ""), address
        host, path = parts.netloc.lower().removeprefix("www."), parts.path.rstrip("/").lower()
        assert spellings.setdefault(f"{host}{path}#{parts.fragment}", address) == address
