"""The API reference: its examples run, it leaves no public name out, and its links to others have the right shape."""

import re
from importlib import import_module

import pytest
from external import external_url
from reference import in_full, signature_of
from snippets import ROOT

import gvp_lib
from gvp_lib import motion, perception, planning

TEXT = {page.stem: page.read_text("utf-8") for page in sorted((ROOT / "book" / "api").glob("*.md"))}
EXAMPLES = {name: re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE) for name, text in TEXT.items()}
DESCRIBED = re.findall(r"^\.\. (?:auto\w+|py:data):: (gvp_lib[\w.]*)$", "\n".join(TEXT.values()), re.MULTILINE)


@pytest.mark.parametrize("page", [name for name in TEXT if name != "index"])
def test_the_examples_of_a_page_run_one_after_the_other(page: str) -> None:
    assert EXAMPLES[page], f"{page}.md opens with no example"
    names: dict[str, object] = {"__name__": "example"}
    for number, example in enumerate(EXAMPLES[page], 1):
        exec(compile(example, f"{page}.md, example {number}", "exec"), names)


@pytest.mark.parametrize("name", sorted({*gvp_lib.__all__} - {"__version__"}))
def test_every_name_at_the_top_is_described_once_has_an_example_and_a_docstring(name: str) -> None:
    assert DESCRIBED.count(f"gvp_lib.{name}") == 1
    examples = "\n".join(example for page in EXAMPLES.values() for example in page)
    assert re.search(rf"\b{name}\b", examples), f"no page of book/api uses {name} in an example"
    assert (getattr(gvp_lib, name).__doc__ or "").strip()


@pytest.mark.parametrize("name", sorted({name for name in DESCRIBED if name.count(".") > 1}))
def test_every_other_name_is_described_once_in_its_room(name: str) -> None:
    room, _, short = name.rpartition(".")
    assert DESCRIBED.count(name) == 1
    assert short in import_module(room).__all__
    assert short not in gvp_lib.__all__


@pytest.mark.parametrize(
    ("name", "address"),
    [
        ("numpy.uint8", "numpy.org/doc/stable/reference/arrays.scalars.html#numpy.uint8"),
        ("scipy.stats.rankdata", "docs.scipy.org/doc/scipy/reference/generated/scipy.stats.rankdata.html"),
        ("torch.nn.Module", "docs.pytorch.org/docs/stable/generated/torch.nn.Module.html"),
        ("torch.Tensor", "docs.pytorch.org/docs/stable/tensors.html#torch.Tensor"),
        ("mujoco.MjModel", "mujoco.readthedocs.io/en/stable/APIreference/APItypes.html#mjmodel"),
        ("gymnasium.Env", "gymnasium.farama.org/api/env/#gymnasium.Env"),
        ("cv2.moments", "docs.opencv.org/4.x/d3/dc0/group__imgproc__shape.html"),
        ("collections.abc.Callable", "docs.python.org/3/library/collections.abc.html#collections.abc.Callable"),
    ],
)
def test_a_name_of_others_has_an_address(name: str, address: str) -> None:
    assert external_url(name) == f"https://{address}"


@pytest.mark.parametrize("name", ["numpy", "nowhere.Thing", "cv2.no_such_function", "gvp_lib.Blob"])
def test_a_name_that_nobody_knows_has_none_so_that_the_build_complains(name: str) -> None:
    assert external_url(name) is None


def test_a_signature_is_what_the_source_says_with_names_in_full() -> None:
    arguments, result = signature_of(motion.traverse_arc)
    assert arguments.startswith("(eye: gvp_lib.Eye, axis: ")
    assert "max_angle: float=np.radians(60)" in arguments
    assert result == "gvp_lib.motion.Arc"
    assert signature_of(planning.Tilt)[0] == "(u: float, v: float, sigma: float)"
    assert (
        "estimator: gvp_lib.planning.ViewpointEstimator = QuarticFit()" in signature_of(planning.ImageMomentPlanner)[0]
    )
    assert signature_of(perception.rgb_to_hsv)[1] == "numpy.typing.NDArray[numpy.float64]"


@pytest.mark.parametrize(
    ("short", "full"),
    [
        ("Blob.ratio", "gvp_lib.Blob.ratio"),
        ("gvp_lib.perception.blobs.Blob", "gvp_lib.Blob"),
        ("NDArray", "numpy.typing.NDArray"),
        ("rgb_to_hsv", "gvp_lib.perception.rgb_to_hsv"),
    ],
)
def test_a_short_name_means_the_public_one(short: str, full: str) -> None:
    assert in_full(short) == full
