"""The book's pages that are generated: claims, the first page's table, run times, and the map.

At the start of a build each becomes a fragment in ``book/generated/``, which git ignores and a page of prose includes.
So no number on them is typed by hand, and none outlives the result that it came from.
"""

from __future__ import annotations

import ast
import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from chapters import BOOK, NOTEBOOKS, write_if_changed
from sphinx.application import Sphinx

import gvp_lib
from gvp_book.claims.claim import Measured, Verdict
from gvp_book.claims.listing import SECTIONS, Judged, Results, judge_all, measured_text, summary, summary_table
from gvp_book.results import read_result

LIBRARY = Path(gvp_lib.__file__).parent
TESTS = LIBRARY.parent / "tests"
RESULTS = BOOK / "results"
_HOLDING = ("geometry", "perception", "motion", "planning", "simulation", "learning", "evaluation")
ROOMS = [*(LIBRARY / room for room in _HOLDING), *(BOOK / "gvp_book" / room for room in ("experiments", "claims"))]
"""Folders whose modules hold the thesis."""


def write_pages(app: Sphinx) -> None:
    """Write every fragment that has changed."""
    results = Results(RESULTS)
    judged = judge_all(results)
    fragments = {
        "claims": "\n".join(claims_page(judged)),
        "results-used": "\n".join(results_table(results)),
        "summary": summary_of(judged),
        "run-times": "\n".join(run_times()),
        "benchmarks": "\n".join(benchmarks(RESULTS / "benchmarks.json")),
        "map": "\n".join(map_table()),
        "map-others": "\n".join(others_table()),
    }
    for name, text in fragments.items():
        write_if_changed(BOOK / "generated" / f"{name}.md", f"{text}\n".encode())


# --- Claims -----------------------------------------------------------------------------------------------------------


def claims_page(judged: Sequence[Judged]) -> Iterator[str]:
    """How many hold, and a table for each section."""
    counts = Counter(each.verdict for each in judged)
    yield "Of " + f"{len(judged)} claims: " + ", ".join(f"{counts[v]} {badge(v)}" for v in Verdict if counts[v]) + "."
    for section, title in SECTIONS.items():
        own = [each for each in judged if each.claim.section == section]
        if own:
            yield f"\n## {section} {title}".rstrip()
            yield "\n:::{list-table}\n:header-rows: 1\n:class: claims of-thesis\n:widths: 43 15 11 16 15\n"
            yield from row(["The thesis says", "Verdict", "Thesis", "Its planner, here", "Ours"])
            for each in own:
                yield from row(cells_of(each))
            yield ":::"


def badge(verdict: Verdict) -> str:
    """A verdict as a small label."""
    return f"[{verdict.value}]{{.verdict .{verdict.name.lower()}}}"


def cells_of(each: Judged) -> list[str]:
    """A claim's row."""
    claim, found = each.claim, each.found
    place = "" if claim.place == "text" else f" [{claim.place}]{{.place}}"
    told = [f"**{claim.says}**{place}", found.why if found else claim.why]
    if claim.rule is not None:
        told.append(f"[Holds if {claim.rule.text}.]{{.rule}}")
    told.append(" · ".join([chapter_link(claim.chapter), *(f"`{command}`" for command in each.commands)]))
    numbers = [number(found.ours), number(found.better)] if found else ["", ""]
    return ["\n\n".join(told), badge(each.verdict), claim.printed.replace(">", "\\>"), *numbers]


def number(measured: Measured | None) -> str:
    """A number with its n below."""
    if measured is None:
        return ""
    return measured_text(measured) + (f"\n\n[n = {measured.n}]{{.count}}" if measured.n else "")


def row(cells: Iterable[str]) -> Iterator[str]:
    """Of a list table."""
    for k, cell in enumerate(cells):
        head, *rest = cell.split("\n")
        yield ("* - " if k == 0 else "  - ") + head
        yield from (f"    {line}" if line else "" for line in rest)


def results_table(results: Results) -> Iterator[str]:
    """What each stored result was computed by."""
    yield ":::{list-table}\n:header-rows: 1\n:class: claims\n:widths: 14 30 8 20 28\n"
    yield from row(["Result", "Command", "Seed", "With", "Tests run again"])
    for name in results:
        told = results.result(name)
        with_ = ", ".join(f"{package} {told['versions'][package]}" for package in ("mujoco", "numpy", "opencv"))
        commit = f"`{told['commit'][:9]}`" if told["commit"] else ""
        yield from row(
            [name, f"`{told['command']}`", ", ".join(map(str, told["seeds"])), f"{with_} {commit}", told["replayed"]]
        )
    yield ":::"


def summary_of(judged: list[Judged]) -> str:
    """The first page's table, in a frame that scrolls by itself on a phone."""
    return f"::::{{div}} wide-table\n{summary_table(summary(judged))}\n::::"


# --- Chapters ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Chapter:
    """What the first cell of a notebook says of it."""

    stem: str
    title: str
    sections: tuple[str, ...]
    seconds: int | None

    @property
    def number(self) -> str:
        """Its two digits."""
        return self.stem[:2]


def read_chapters() -> list[Chapter]:
    """Every chapter, in order."""
    found = []
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        head = "".join(json.loads(path.read_text(encoding="utf-8"))["cells"][0]["source"])
        title = re.search(r"^# (.+)$", head, flags=re.MULTILINE)
        thesis = re.search(r"^\*\*Thesis\W+(.+)$", head, flags=re.MULTILINE)
        time = re.search(r"Run time\W+about (\d+) s", head)
        sections = sections_in(thesis[1] if thesis else "")
        found.append(Chapter(path.stem, title[1] if title else path.stem, sections, int(time[1]) if time else None))
    return found


def sections_in(text: str) -> tuple[str, ...]:
    """Numbers of sections that a citation of the thesis names, without its figures, tables, equations and errata."""
    text = re.split(r"errat|\{cite", text)[0]
    text = re.sub(r"(?:Figs|Eqs|Tables)\.? [\d.]+\d(?:(?:,| and| to|, and) \d\.\d+(?!\.\d))*", "", text)
    text = re.sub(r"(?:Fig\.|Eq\.|Table|Algorithms?|Figure) [A\d.]*\d", "", text)
    numbers = re.findall(r"(?<![\d.])(?:\d(?:\.\d)*|A\.\d)(?![\d])", text)
    named = ["Abstract", *numbers] if "abstract" in text.lower() else numbers
    return tuple(dict.fromkeys(number for number in named if number in SECTIONS))


def chapter_link(stem: str) -> str:
    """To a chapter, or its number alone where it is not there."""
    name = f"chapter {stem[:2]}"
    return f"[{name}](notebooks/{stem}.ipynb)" if (NOTEBOOKS / f"{stem}.ipynb").exists() else name


def run_times() -> Iterator[str]:
    """How long each chapter takes, as its notebook says."""
    chapters = read_chapters()
    yield "| | chapter | run time |\n|:--|:--|--:|"
    for each in chapters:
        seconds = "" if each.seconds is None else f"{each.seconds} s"
        yield f"| {each.number} | [{each.title}](notebooks/{each.stem}.ipynb) | {seconds} |"
    yield f"| | all of them | {sum(each.seconds or 0 for each in chapters) / 60:.0f} min |"


def benchmarks(path: Path) -> Iterator[str]:
    """This version's times beside those of 0.1, as `make bench` measured them."""
    result = read_result(path)
    cores = "{cores} {machine} cores".format(**result["hardware"])
    yield f"Measured by `{result['command']}` on {cores}, one after the other.\n"
    yield "| | version 0.1 | now | ratio |\n|:--|--:|--:|--:|"
    for row in (row for rows in result["content"]["rows"].values() for row in rows):
        before, now, ratio = (row.get(name) for name in ("before_s", "now_s", "ratio"))
        times = ["" if value is None else duration(value) for value in (before, now)]
        yield f"| {row['what']} | {times[0]} | {times[1]} | {'' if ratio is None else f'{ratio:.2f}'} |"


def duration(seconds: float) -> str:
    """In the unit that suits it."""
    if seconds < 1:
        return f"{1000 * seconds:.1f} ms"
    return f"{seconds:.1f} s" if seconds < 60 else f"{seconds / 60:.1f} min"


# --- The map ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Module:
    """A file: its place below ``gvp_lib`` or ``book``, its first line, the sections that it comes from."""

    place: str
    says: str
    sections: tuple[str, ...]
    tests: tuple[str, ...]


def read_modules() -> list[Module]:
    """Every module of the rooms that hold the thesis."""
    sources = {path: path.read_text(encoding="utf-8") for path in sorted(TESTS.rglob("test_*.py"))}
    found = []
    for path in (path for room in ROOMS for path in sorted(room.glob("*.py")) if path.stem != "__init__"):
        doc = " ".join((ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").split())
        cited = " ".join(part for part in re.findall(r"[Tt]hesis (?=[\dA-Z(])(.*?)(?:errat|\.(?= [A-Z])|\.?$)", doc))
        place = path.relative_to(LIBRARY if path.is_relative_to(LIBRARY) else BOOK)
        found.append(Module(place.as_posix(), doc.split(". ")[0], sections_in(cited), tests_of(path, sources)))
    return found


def tests_of(path: Path, sources: dict[Path, str]) -> tuple[str, ...]:
    """The test that mirrors a module; where there is none, the first that import it or use a name of its, near it."""
    ours = path.is_relative_to(LIBRARY)
    room = path.parent.name if ours else "reproduction"
    own = TESTS / room / f"test_{path.parent.name if path.parent.name == 'claims' else path.stem}.py"
    if own in sources:
        return (own.relative_to(TESTS).as_posix(),)
    dotted = ".".join(path.with_suffix("").relative_to(LIBRARY.parent if ours else BOOK).parts)
    using = [test for test, source in sources.items() if re.search(rf"\b{re.escape(dotted)}\b", source)]
    if not using:
        named = re.search(r"__all__ = \[([^]]+)]", path.read_text(encoding="utf-8"))
        names = re.findall(r"\w+", named[1]) if named else []
        using = [test for test, source in sources.items() if any(re.search(rf"\b{n}\b", source) for n in names)]
    near = [test for test in using if room in test.parts] or using
    return tuple(test.relative_to(TESTS).as_posix() for test in near[:2])


def map_table() -> Iterator[str]:
    """Section by section: files, tests, chapters."""
    modules, chapters = read_modules(), read_chapters()
    yield ":::{list-table}\n:header-rows: 1\n:class: claims map\n:widths: 24 30 30 16\n"
    yield from row(["Thesis", "gvp_lib/ or book/", "tests/", "Chapter"])
    for section, title in SECTIONS.items():
        own = [module for module in modules if section in module.sections]
        told = [chapter for chapter in chapters if section in chapter.sections]
        if own or told:
            tests = dict.fromkeys(test for module in own for test in module.tests)
            files = ["\\\n".join(f"`{name}`" for name in names) for names in ([m.place for m in own], tests)]
            links = ", ".join(f"[{each.number}](notebooks/{each.stem}.ipynb)" for each in told)
            yield from row([f"**{section}** {title}", *files, links])
    yield ":::"


def others_table() -> Iterator[str]:
    """What cites no section: what the thesis has not, or does not say."""
    yield ":::{list-table}\n:header-rows: 1\n:class: claims map\n:widths: 30 44 26\n"
    yield from row(["gvp_lib/ or book/", "What it is", "tests/"])
    for module in read_modules():
        if not module.sections:
            says = module.says.replace("``", "`").rstrip(".")
            yield from row([f"`{module.place}`", says, "\\\n".join(f"`{test}`" for test in module.tests)])
    yield ":::"


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
