"""Public docstrings: numpydoc's rules, those of this house, and an example for whatever a user calls."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Iterator
from typing import Any

import pytest
from numpydoc.docscrape import NumpyDocString, get_doc_object
from numpydoc.validate import validate
from public_names import ROOMS, exported, is_kind_of_type, methods_of

import gvp_lib

pytestmark = pytest.mark.check
every_room = pytest.mark.parametrize("room", ROOMS)

# Checks of numpydoc that do not fit here: types stand in the annotations, and the summary often says what is returned.
# Which names need an example is a test of its own.
IGNORED = {
    "GL01", "GL02",  # text begins and ends beside the quotes
    "SS05",  # takes any plural for a verb; THIRD_PERSON asks for an article too
    "ES01", "SA01", "EX01",  # sections that may be absent
    "PR04", "RT01", "RT02", "RT04", "RT05", "YD01",
}  # fmt: skip
SECTIONS = "Parameters", "Attributes", "Returns", "Yields", "Raises"
THIRD_PERSON = re.compile(r"[A-Z][a-z]+[a-rt-z]s (an?|the|its|each|every|what|where|whether|which|how)\b")
RETIRED = re.compile(
    r"\b(told|shrunk|guards?|betrays?|who(m|so)?ever|nobody|somebody|lest|thereof|wherein|whereby|is to be had|save for"
    r"|by lot|of yours|as (it|they) (says?|tells?))\b"
)
"""Words of public docstrings that read like a translation."""
RETIRED_NAMES = re.compile(r"(^|_)(told|shrunk|pass_over|guards?|kept)(_|$)", re.IGNORECASE)

RESULTS = {
    "geometry": {"Calibration", "HandEye"},
    "perception": {"Outline"},
    "motion": {"Adjustment", "Arc", "View"},
    "planning": {"FittedSolid", "Grasp", "Grip", "PickUp", "Plan", "Quartic", "Reading", "Step", "VisualHull"},
    "photographs": {"Photographs"},
    "simulation": {
        "AcceptedNormal", "ContactRecord", "EpisodeNoise", "FloatingCamera", "RangeSensor", "SimulatedArm",
        "SimulatedGripper", "Truth",
    },
    "learning": {"Collection", "Label", "Labels", "TrainedNetwork", "Training"},
    "evaluation": {
        "Comparison", "GraspableView", "Interval", "JudgedGrip", "Judgement", "Start", "Summary", "ViewpointError",
    },
    "views": {"Recording"},
    "jobs": {"JobResult"},
}  # fmt: skip
"""Classes that a call or a cell gives, and a user does not construct: the example is the call's."""
NO_EXAMPLE = {
    "jobs.dask_cluster": "needs a cluster: environment/README.md has an example, and tests/test_cluster.py runs one",
    "jobs.disk_errors": "for the library's own files",
    "jobs.open_locked": "for the library's own files",
    "jobs.write_file": "for the library's own files",
    "learning.BasicBlock": "a name for an Architecture; ResNet has the example",
    "learning.Bottleneck": "a name for an Architecture; ResNet has the example",
    "picture.Pictured": "a class to inherit from: every picture in the book is an example",
    **{
        name: "what a user calls is .plot()"
        for name in map("views.{}".format, exported("views"))
        if name.startswith("views.plot_")
    },
}
"""What has no example, and the reason."""


def documented(room: str) -> Iterator[tuple[str, Any]]:
    """Every public class and function of a room, and their public methods, by name."""
    for name, value in exported(room).items():
        yield f"{room}.{name}", value
        if inspect.isclass(value):
            yield from ((f"{room}.{name}.{method}", function) for method, function in methods_of(value))


def parsed(value: Any) -> NumpyDocString:
    return NumpyDocString(inspect.cleandoc(value.__doc__ or ""))


def findings_of(value: Any) -> Iterator[str]:
    """What is wrong with a docstring."""
    text = inspect.cleandoc(value.__doc__ or "")
    sections = parsed(value)
    entries = [each for section in SECTIONS for each in sections[section]]
    for part in (text, *("\n".join(entry.desc) for entry in entries)):
        if re.match(r"[Oo]f ", part):
            yield f"OF begins with 'Of': {part.splitlines()[0]}"
    if inspect.isfunction(value) and (match := THIRD_PERSON.match(text)):
        yield f"VERB {match[0]!r}: write the infinitive"
    yield from (f"WORD {word!r}: say it as the field does" for word in sorted({m[0] for m in RETIRED.finditer(text)}))
    if text.startswith("See :"):  # a method of a protocol, described there
        return
    errors = [(code, said) for code, said in validate(get_doc_object(value))["errors"] if code not in IGNORED]
    if isinstance(value, property) or is_kind_of_type(value):
        errors = [each for each in errors if not each[0].startswith("PR")]
    elif dataclasses.is_dataclass(value):  # its fields are Parameters or Attributes
        names = {name.lstrip("*\\") for entry in entries for name in re.split(r"\s*,\s*", entry.name)}
        fields = [field.name for field in dataclasses.fields(value) if field.init and not field.name.startswith("_")]
        errors = [each for each in errors if each[0] not in ("PR01", "PR02")]
        errors += [("PR01", f"{field} is not documented") for field in fields if field not in names]
    yield from (f"{code} {said}" for code, said in errors)


def report(findings: list[str]) -> None:
    if findings:
        pytest.fail("\n".join([f"{len(findings)} findings", *findings]), pytrace=False)


@every_room
def test_a_public_docstring_is_well_formed_and_says_things_as_the_field_does(room: str) -> None:
    report([f"{name}: {each}" for name, value in documented(room) for each in findings_of(value)])


@every_room
def test_public_names_and_parameters_use_no_retired_word(room: str) -> None:
    names = {}
    for name, value in documented(room):
        has_parameters = inspect.isfunction(value) or (inspect.isclass(value) and not is_kind_of_type(value))
        parameters = inspect.signature(value).parameters if has_parameters else ()
        names |= {f"{name}({parameter})": parameter for parameter in parameters} | {name: name.rpartition(".")[2]}
    report([name for name, word in names.items() if RETIRED_NAMES.search(word)])


@every_room
def test_what_a_user_calls_or_constructs_has_an_example(room: str) -> None:
    exempt = RESULTS.get(room, set()) | {name.partition(".")[2] for name in NO_EXAMPLE if name.startswith(f"{room}.")}
    called = {name: v for name, v in exported(room).items() if name not in exempt and not is_kind_of_type(v)}
    report([f"{room}.{name} has no Examples" for name, value in called.items() if not parsed(value)["Examples"]])


def test_whatever_the_front_door_exports_is_exported_by_a_room() -> None:
    """So the tests above see it."""
    public = {id(value) for room in ROOMS for value in exported(room).values()}
    values = {name: getattr(gvp_lib, name) for name in gvp_lib.__all__}
    callables = {name: each for name, each in values.items() if inspect.isclass(each) or inspect.isfunction(each)}
    report([name for name, each in callables.items() if id(each) not in public])


def test_no_exception_from_the_rules_has_outlived_its_name() -> None:
    exempt = [f"{room}.{name}" for room, names in RESULTS.items() for name in names] + [*NO_EXAMPLE]
    report([each for each in exempt if each.partition(".")[2] not in exported(each.partition(".")[0])])


@pytest.mark.parametrize(
    ("docstring", "found"),
    [
        ("Depth of a point, m.\n\nParameters\n----------\nx\n    Of a pixel, its column.\n", "OF"),
        ("Moves the camera.\n\nParameters\n----------\nx\n    Column of a pixel.\n", "VERB"),
        ("Move as told.\n\nParameters\n----------\nx\n    Column of a pixel.\n", "WORD"),
        ("Move the camera.", "PR01"),
        ("Move the camera\nas far as it goes.\n\nParameters\n----------\nx\n    Column of a pixel.\n", "SS06"),
        ("Move the camera.\n\nParameters\n----------\nx\n    Column of a pixel\n", "PR09"),
        ("Move the camera.\n\nParameters\n----------\ny\n    Row of a pixel.\n", "PR01 PR02"),
        ("Pixels of a row.\n\nParameters\n----------\nx\n    Column of a pixel.\n", ""),
        ("See :class:`Arm`.", ""),
    ],
)
def test_the_rules_catch_what_they_are_for(docstring: str, found: str) -> None:
    def function(x):
        return x

    function.__doc__ = docstring
    assert " ".join(sorted(each.split()[0] for each in findings_of(function))) == found
