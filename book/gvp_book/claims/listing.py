"""Every claim in the thesis's order, judged by the stored results, and the tables that show it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from gvp_book.claims import alignment, grasping, learned
from gvp_book.claims.claim import Claim, Found, Measured, Verdict
from gvp_book.plots.tables import Table
from gvp_book.results import read_result
from gvp_lib.errors import ResultError

SECTIONS: Mapping[str, str] = {
    "Abstract": "",
    "1.2": "Hardware",
    "1.3": "Software",
    "2.1": "Perception",
    "2.1.1": "Thresholds",
    "2.1.2": "Object detection",
    "2.2": "Spherical traversal",
    "2.3": "The image-moment planner",
    "2.3.1": "Its algorithm",
    "2.4": "The learned planner",
    "2.4.1": "Network",
    "2.4.2": "Training data",
    "2.4.3": "Pre-processing",
    "2.4.4": "Training procedure",
    "2.4.5": "Evaluation procedure",
    "3.1": "Experiments with the image-moment planner",
    "3.1.1": "Setup",
    "3.1.2": "The error by a homography",
    "3.1.3": "Bricks",
    "3.1.4": "The can",
    "3.1.5": "The alligator",
    "3.1.6": "Alignment accuracy",
    "3.1.7": "Grasping accuracy",
    "3.2": "Experiments with the learned planner",
    "3.2.1": "Training results",
    "3.2.2": "Viewpoints in simulation",
    "3.2.3": "Other objects",
    "4": "Conclusion",
    "A.1": "Depth",
    "A.2": "Homography",
    "A.3": "Poses on the sphere",
    "A.4": "Cross-entropy",
    "A.5": "Accuracy",
}
"""The thesis's, by number, with short titles of our own."""

_BEYOND = "08_beyond_the_thesis"
_COMPUTED = (
    Claim("2.1", "text", "Any detector that outputs boxes may take the threshold's place", "", "01_hsv_and_moments",
          why="A detector of boxes and a segmenter without any color run in its place. The first planner needs the "
          "blob's angle besides, as the thesis says itself."),
    Claim("2.1", "text", "Several objects could be in view without much added complexity", "", _BEYOND,
          why="It takes a tracker that stays with one of them, and little else."),
    Claim("2.1", "text", "Saliency would allow for objects of any color", "", _BEYOND,
          why="The first planner runs on a saliency segmenter; the chapter sets its errors beside those of the "
          "threshold. The second was not tried with it."),
    Claim("2.2", "text", "Correcting the distance makes the traversal more accurate", "", "02_sphere_traversal",
          why="Without it the distance grows as a square root; the chapter walks both ways and measures."),
    Claim("4", "text", "Both planners depend on the arm's workspace, and a holonomic base would lift that", "", _BEYOND,
          why="The chapter counts how much of the sphere each arm reaches, with a base and without."),
    Claim("4", "text", "The second planner is ready for a real robot", "", _BEYOND,
          why="Nothing here has moved a real arm. The chapter lists what remains to be done before one."),
    Claim("A.1", "Eq. A.1", "One step and its parallax give the distance", "", "02_sphere_traversal",
          why="In a perfect simulation to all digits; on a noisy arm the error halves as the step doubles."),
)  # fmt: skip
"""Claims that a chapter computes while it is read, so that no result is stored."""

CLAIMS: tuple[Claim, ...] = tuple(
    sorted(
        (*alignment.CLAIMS, *grasping.CLAIMS, *learned.CLAIMS, *_COMPUTED),
        key=lambda claim: list(SECTIONS).index(claim.section),
    )
)
"""All of them, section by section."""


@dataclass(frozen=True, slots=True)
class Judged:
    """Claim with what was found and the verdict of its rule."""

    claim: Claim
    found: Found | None  # None where a chapter computes it
    verdict: Verdict
    commands: tuple[str, ...] = ()  # what reproduces each of its results


class Results(Mapping[str, Any]):
    """Contents of a folder's stored results, by name; each file is read once, when first needed."""

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)
        self.result = cache(lambda name: read_result(self.folder / f"{name}.json"))
        """The whole result of a name, with its command and what computed it; ResultError where there is none."""

    def __getitem__(self, name: str) -> Any:
        return self.result(name)["content"]

    def __iter__(self) -> Iterator[str]:
        return (path.stem for path in sorted(self.folder.glob("*.json")))

    def __len__(self) -> int:
        return sum(1 for _ in self)


def judge(claim: Claim, results: Results) -> Judged:
    """Judge one claim by the stored results.

    Raises ResultError if a result that the claim names is missing, or lacks what the claim is measured by."""
    if claim.measure is None or claim.rule is None:
        return Judged(claim, None, Verdict.CHAPTER)
    commands = tuple(results.result(name)["command"] for name in claim.results)
    try:
        found = claim.measure(results)
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise ResultError(
            f"{' or '.join(claim.results)} in {results.folder} lacks what {claim.says!r} ({claim.section}) is measured "
            f"by: {type(error).__name__}: {error}. Compute it anew: {commands[0]}"
        ) from error
    return Judged(claim, found, claim.rule.judge(found.ours, found.beside), commands)


def judge_all(results: Results) -> list[Judged]:
    """Judge every claim, in the thesis's order."""
    return [judge(claim, results) for claim in CLAIMS]


def summary(judged: list[Judged]) -> list[Judged]:
    """Choose a few that represent all: each object's cell of each table, and the rate over all grasps."""
    return [
        each
        for each in judged
        if (each.claim.place.startswith("Table") and not each.claim.says.endswith(("orientation 1", "orientation 2")))
        or each.claim.measure is grasping.CLAIMS[0].measure
    ]


_SPACE = "\N{NO-BREAK SPACE}"  # so that a narrow column breaks before an interval, and nowhere else


def measured_text(measured: Measured | None) -> str:
    """Number with its interval, as text; empty for None."""
    if measured is None:
        return ""
    text = str(measured).replace("-", "\N{MINUS SIGN}").replace(", ", f",{_SPACE}").replace(" ± ", f"{_SPACE}±{_SPACE}")
    return text.replace("] ", f"]{_SPACE}")


def _count(found: Found) -> str:
    """How many of each were measured; one number where both are the same."""
    each = dict.fromkeys(str(measured.n) for measured in (found.ours, found.better) if measured and measured.n)
    return f",{_SPACE}".join(each)


def claims_table(judged: Iterable[Judged]) -> Table:
    """Table of claims: where, what, the thesis's value, its planner in our cell, our planner, n, and the verdict."""
    rows = []
    for each in judged:
        claim, found = each.claim, each.found
        verdict = each.verdict.value if found else f"{each.verdict.value} {claim.chapter[:2]}"
        numbers = [measured_text(found.ours), measured_text(found.better), _count(found)] if found else [""] * 3
        rows.append([_place(claim), claim.says, claim.printed, *numbers, verdict])
    return Table(["where", "the thesis says", "printed", "reproduced", "our planner", "n", "verdict"], rows)


def summary_table(judged: Iterable[Judged]) -> Table:
    """Short table for a first page, of the claims that :func:`summary` chooses."""
    rows = []
    for each in judged:
        if (found := each.found) is not None:
            numbers = measured_text(found.ours), measured_text(found.better), _count(found)
            rows.append([each.claim.says, _place(each.claim), each.claim.printed, *numbers])
    return Table(["what", "where", "thesis", "reproduced", "ours", "n"], rows)


def _place(claim: Claim) -> str:
    return claim.section if claim.place == "text" else claim.place
