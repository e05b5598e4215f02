"""Who may know whom: the directions of the house, and what ``import gvp_lib`` may cost."""

import ast
import json
import os
import re
import subprocess
import sys
import warnings
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from importlib import import_module
from pathlib import Path

import pytest
import snippets

import gvp_book
import gvp_lib
from gvp_lib.errors import RenderingError

pytestmark = pytest.mark.check

ROOT = Path(gvp_lib.__file__).parent
BOOK = Path(gvp_book.__file__).parent

# From the ground up: a room, the rooms it may know, and the outside packages it may use besides NumPy and SciPy. Every
# room may know `checks`, `errors` and `picture`. What is not in this table does not exist: a new room starts with a
# line here.
# fmt: off
HOUSE = {
    "lazy":        (set(),                                                            set()),
    "__init__":    (set(),                                                            set()),
    "errors":      (set(),                                                            set()),
    "checks":      (set(),                                                            set()),
    # the only one that looks up, when asked for a picture
    "picture":     ({"views"},                                                        {"matplotlib"}),
    "jobs":        (set(),                                                            {"tqdm", "distributed"}),
    # ground: the two ignore each other
    "geometry":    (set(),                                                            {"cv2"}),
    "perception":  (set(),                                                            {"cv2", "contourpy"}),
    # first and second floor: no simulator
    "motion":      ({"geometry", "perception"},                                       {"cv2"}),
    "planning":    ({"geometry", "perception", "motion"},                             {"cv2"}),
    "photographs": ({"geometry", "perception", "motion"},                    {"cv2", "tqdm", "rosbags", "ruamel"}),
    # the wing, the only room that knows the truth
    "simulation":  ({"geometry", "perception", "motion"},                             {"cv2", "mujoco", "mink"}),
    # third floor: torch lives in `learning` alone
    "learning":    ({"geometry", "perception", "motion", "planning", "simulation", "jobs"},
                    {"cv2", "torch", "safetensors", "pyarrow", "gymnasium", "tqdm"}),
    "evaluation":  ({"geometry", "perception", "motion", "planning", "simulation"},   {"cv2"}),
    # the balcony: it sees everything, and nobody looks up to it
    "views":       ({"geometry", "perception", "motion", "planning", "photographs", "simulation", "learning",
                     "evaluation"},
                    {"cv2", "mujoco", "matplotlib", "PIL", "IPython", "ipywidgets", "tornado"}),
    "doctor":      ({"simulation"}, {"mujoco", "OpenGL", "packaging", "torch", "jupyter_client"}),
    "cli":         ({"doctor", "planning", "photographs", "simulation", "learning", "views", "jobs"}, set()),
    "__main__":    ({"cli"},                                                          set()),
    # the book, on its own ground: it uses the library as a stranger would
    "gvp_book":    ({"geometry", "perception", "motion", "planning", "photographs", "simulation", "learning",
                     "evaluation", "views", "jobs", "cli"},
                    {"cv2", "mujoco", "matplotlib", "PIL"}),
}
# fmt: on
EVERYWHERE = {"numpy", "scipy"}
# Rooms above all others, which may use the public names as a user does.
FRONT_DOOR = {"learning", "views", "cli", "doctor", "gvp_book"}
HEAVY = {"torch", "mujoco", "mink", "cv2", "scipy", "matplotlib", "meshcat", "pyarrow", "gymnasium"}
EXTRAS = {
    "torch", "gymnasium", "pyarrow", "safetensors", "matplotlib", "meshcat", "PIL", "IPython", "ipywidgets", "tornado",
    "rosbags", "ruamel",
}  # fmt: skip
"""Packages that the library imports and only its extras, or what they bring, install."""
SOURCES = {
    path.relative_to(base): path
    for base, package in ((ROOT, ROOT), (BOOK.parent, BOOK))
    for path in sorted(package.rglob("*.py"))
}
"""Files of the library by their place in it, and those of the book below ``gvp_book``."""
PUBLIC = ["gvp_lib", *sorted(f"gvp_lib.{path.parent.name}" for path in ROOT.glob("*/__init__.py"))]
PUBLIC += sorted(f"gvp_book.{path.parent.name}" for path in BOOK.glob("*/__init__.py"))
PAGES = sorted(
    page
    for pattern in ("*.md", "book/*.md", "book/api/*.md", "book/guide/*.md", "notebooks/*.ipynb")
    for page in snippets.ROOT.glob(pattern)
)


def imports_of(source: str) -> list[str]:
    """Full names of what a module imports anywhere in it, in functions and for types too."""
    names: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names += ["a relative import"] if node.level else [f"{node.module}.{alias.name}" for alias in node.names]
    return names


def room_of(module: Path) -> str:
    return module.parts[0].removesuffix(".py")


def name_of(module: Path) -> str:
    """A module's name, without ``gvp_lib``; a room's ``__init__.py`` is the room."""
    return ".".join(module.with_suffix("").parts).removesuffix(".__init__")


def trespasses(module: Path, source: str) -> list[str]:
    """What a module imports although its room may not."""
    room = room_of(module)
    rooms, packages = HOUSE[room]
    if module.name == "__init__.py":
        rooms = {*rooms, "lazy"}
    found = []
    for name in imports_of(source):
        top, *rest = name.split(".")
        if top == "gvp_lib":
            # A public name or the version, from the front door, is for those above every room.
            target = rest[0] if rest and rest[0] in HOUSE else "the front door"
            allowed = target in {room, "checks", "errors", "picture"} | rooms or (
                target == "the front door" and room in FRONT_DOOR
            )
        else:
            allowed = top in sys.stdlib_module_names | EVERYWHERE | packages | ({"gvp_book"} & {room})
        if not allowed:
            found.append(f"{room} may not know {name}")
    return found


@pytest.mark.parametrize("module", SOURCES, ids=str)
def test_a_module_imports_only_what_its_room_may(module: Path) -> None:
    assert trespasses(module, SOURCES[module].read_text("utf-8")) == []


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("geometry/x.py", "from gvp_lib.perception.blobs import Blob"),
        ("geometry/x.py", "def f():\n    import torch"),
        ("perception/x.py", "from ..geometry import camera"),
        ("motion/x.py", "from gvp_lib import simulation"),
        ("planning/x.py", "import gvp_lib.simulation.workcell as w"),
        ("planning/x.py", "from gvp_lib import WorkCell"),
        ("evaluation/x.py", "from gvp_book.results import read_result"),
        ("gvp_book/x.py", "import torch"),
        ("learning/x.py", "from gvp_lib.views.figures import trace"),
    ],
)
def test_the_rule_catches_a_trespass(module: str, source: str) -> None:
    assert len(trespasses(Path(module), source)) == 1


def test_a_room_knows_only_rooms_below_it_and_only_the_book_looks_up_to_the_balcony() -> None:
    below: set[str] = set()
    for room, (known, _) in HOUSE.items():
        assert known <= below or room == "picture", room
        assert "views" not in known or room in ("picture", "gvp_book", "cli")
        below.add(room)


@pytest.mark.parametrize("room", [room for room in HOUSE if room != "__init__"])
def test_no_file_of_a_room_knows_one_that_knows_it_not_even_for_types_nor_round_a_longer_circle(room: str) -> None:
    modules = {name_of(module): path for module, path in SOURCES.items() if room_of(module) == room}
    knows: dict[str, set[str]] = {}
    for name, path in modules.items():
        imported = {each.removeprefix("gvp_lib.") for each in imports_of(path.read_text("utf-8"))}
        knows[name] = {each if each in modules else each.rpartition(".")[0] for each in imported}
    try:
        TopologicalSorter(knows).prepare()
    except CycleError as error:
        pytest.fail(" knows ".join(reversed(error.args[1])))


def said_by(program: str) -> str:
    """What a program prints in a fresh process."""
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize(
    ("statement", "unwanted"),
    [
        ("import gvp_lib", {*HEAVY, "numpy"}),
        ("import gvp_lib.cli, gvp_lib.doctor", {*HEAVY, "numpy", "packaging"}),
        ("import gvp_lib.planning", {"torch", "mujoco", "mink", "matplotlib"}),
        ("from gvp_lib.learning import CollectionRecipe", {"torch", "pyarrow", "gymnasium", "matplotlib"}),
        ("import gvp_lib.learning, gvp_lib.views, gvp_book.plots, gvp_book.experiments, gvp_book.claims", HEAVY),
    ],
)
def test_importing_the_library_or_its_command_loads_nothing_heavy(statement: str, unwanted: set[str]) -> None:
    loaded = {name.split(".")[0] for name in said_by(f"{statement}\nimport sys\nprint(*sys.modules)").split()}
    assert "gvp_lib" in loaded
    assert loaded & unwanted == set()


@pytest.mark.parametrize("package", PUBLIC)
def test_every_public_name_resolves(package: str) -> None:
    module = import_module(package)
    assert {*module.__all__} <= {*dir(module)}
    assert len({*module.__all__}) == len(module.__all__)
    for name in module.__all__:
        assert getattr(module, name) is not None, name


@pytest.mark.parametrize("room", [package for package in PUBLIC if package.startswith("gvp_lib.")])
def test_a_room_offers_only_what_its_files_mean_to_stay(room: str) -> None:
    files = [name for name in map(name_of, SOURCES) if f"gvp_lib.{name}".startswith(f"{room}.")]
    meant = {name for file in files for name in getattr(import_module(f"gvp_lib.{file}"), "__all__", ())}
    meant |= {file.rpartition(".")[2] for file in files}
    assert {*import_module(room).__all__} <= meant


def public_in(package: str) -> set[str]:
    """Names that a package offers; a file without ``__all__`` offers all that it defines."""
    module = import_module(package)
    return {*getattr(module, "__all__", vars(module))}


def code_of(page: Path) -> Iterator[str]:
    """Python of a chapter's cells, or of a page's blocks."""
    if page.suffix == ".ipynb":
        cells = json.loads(page.read_text("utf-8"))["cells"]
        yield from ("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    else:
        found = snippets.blocks(page) + snippets.blocks(page, shown=True)
        yield from (block.code for block in found if block.language == "python")


def not_public(code: str) -> list[str]:
    """What code imports otherwise than a user does."""
    found = []
    for name in imports_of(code):
        package, _, short = name.rpartition(".")
        if package.split(".")[0] in ("gvp_lib", "gvp_book"):
            if package.count(".") > 1:
                found.append(f"{name} is inside a room")
            elif short not in public_in(package):
                found.append(f"{package} does not offer {short}")
            elif package != "gvp_lib" and short in gvp_lib.__all__:
                found.append(f"{short} stands at the top, not only in {package}")
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_chapter_or_page_imports_from_the_top_and_from_rooms_alone(page: Path) -> None:
    assert [each for code in code_of(page) for each in not_public(code)] == []


def test_so_does_an_example_in_a_docstring() -> None:
    for module, path in SOURCES.items():
        imports = re.findall(r"^ *>>> (from gvp_.*)$", path.read_text("utf-8"), re.MULTILINE)
        assert not_public("\n".join(imports)) == [], module


@pytest.mark.parametrize(("old", "new"), gvp_lib._MOVED.items(), ids=gvp_lib._MOVED)
def test_a_name_that_moved_from_the_top_works_and_says_where_it_is(old: str, new: str) -> None:
    package, _, name = new.rpartition(".")
    with pytest.warns(DeprecationWarning, match=rf"^gvp_lib\.{old} is {re.escape(new)} from 0\.2 on") as warned:
        found = getattr(gvp_lib, old)
    assert warned[0].filename == __file__
    assert found is getattr(import_module(package), name)
    assert name in import_module(package).__all__


def test_a_name_that_moved_says_so_once_at_each_place() -> None:
    program = compile("for _ in range(2):\n  from gvp_lib import View\nfrom gvp_lib import View", "there.py", "exec")
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("default")
        exec(program, {"__name__": "there"})
    assert [(each.filename, each.lineno) for each in warned] == [("there.py", 2), ("there.py", 3)]


def test_the_library_itself_uses_no_name_that_moved() -> None:
    program = "\n".join(f"from {package} import *" for package in PUBLIC)
    subprocess.run([sys.executable, "-W", "error:gvp_lib:DeprecationWarning", "-c", program], check=True)


def test_an_unknown_public_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no_such_name"):
        gvp_lib.no_such_name  # noqa: B018


@pytest.mark.parametrize(
    ("module", "instead", "name", "said"),
    [
        ("tornado", "None", "Scene3D", r"MissingExtraError Scene3D needs tornado.*pip install '.*\[notebooks\]'"),
        ("mujoco", "types.ModuleType('mujoco')", "WorkCell", "ImportError .*WorkCell.*'mujoco' has no attribute"),
    ],
)
def test_a_name_whose_module_does_not_load_says_why(module: str, instead: str, name: str, said: str) -> None:
    program = (
        f"import sys, types; sys.modules[{module!r}] = {instead}\n"
        f"try: from gvp_lib import {name}\n"
        "except ImportError as error: print(type(error).__name__, error)"
    )
    assert re.search(said, said_by(program))


WITHOUT_LIBRARIES = """
import ctypes, ctypes.util, os, re

def hidden(name): return re.search(os.environ["HIDDEN"], str(name))

load, find = ctypes.CDLL.__init__, ctypes.util.find_library
ctypes.util.find_library = lambda name: None if hidden(name) else find(name)

def init(self, name, *others, **more):
    if hidden(name): raise OSError(f"{name}: cannot open shared object file")
    load(self, name, *others, **more)

ctypes.CDLL.__init__ = init
"""
WAYS_IN = (
    "from gvp_lib.views import Scene3D",
    "from gvp_lib import WorkCell",
    "from gvp_lib import FloatingCamera",  # which moved
    "from gvp_lib.simulation import WorkCell",
    "import gvp_lib.simulation.workcell",
    "from gvp_lib.learning import ViewpointEnv",
    "from gvp_book.experiments import align_once",
)
TRY_THEM = f"""
for line in {WAYS_IN}:
    try: exec(line)
    except Exception as error: print(f"{{type(error).__name__}}: {{error}}")
from gvp_lib.doctor import check_rendering
found = check_rendering()
print(found.detail, found.mend, sep="\\n")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere MuJoCo loads no library of these")
@pytest.mark.parametrize(("backend", "library"), [("egl", "EGL"), ("osmesa", "OSMesa")])
def test_without_the_library_that_draws_every_way_in_says_what_is_missing_and_what_mends_it_as_the_doctor_does(
    backend: str, library: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sitecustomize.py").write_text(WITHOUT_LIBRARIES)
    monkeypatch.setenv("HIDDEN", library)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    monkeypatch.setenv("MUJOCO_GL", backend)
    monkeypatch.delenv("PYOPENGL_PLATFORM", raising=False)  # which MuJoCo has set in this process
    wanted = RenderingError(f"there is no lib{library}")
    assert wanted.mend in str(wanted)
    said = [f"RenderingError: {wanted}"] * len(WAYS_IN)
    assert said_by(TRY_THEM).splitlines() == [*said, f"no frame: {wanted.reason} ({backend})", wanted.mend]


WITHOUT_EXTRAS = f"""
import sys
from importlib.machinery import PathFinder
find = PathFinder.find_spec
PathFinder.find_spec = lambda name, *others: None if name.split(".")[0] in {EXTRAS} else find(name, *others)
import gvp_lib, inspect, re
from gvp_lib import *
inspect.getmembers(gvp_lib)  # as help() does
stub = open(f"{{gvp_lib.__path__[0]}}/__init__.pyi").read()
for name in re.findall(r" as (\\w+)", stub):
    try: loads = getattr(gvp_lib, name) is globals()[name]
    except gvp_lib.errors.MissingExtraError as error: loads = False
    assert loads == (name in gvp_lib.__all__) == (name in dir(gvp_lib)), name
print(WorkCell, *{{*re.findall(r" as (\\w+)", stub)}} - {{*gvp_lib.__all__}})
"""


def test_without_any_extra_an_import_of_all_brings_all_that_needs_none() -> None:
    cell, *missing = said_by(WITHOUT_EXTRAS).rsplit(">")
    assert cell == "<class 'gvp_lib.simulation.workcell.WorkCell'"
    assert {"Scene3D", "ViewpointEnv", "train"} <= {*missing[0].split()} < {*gvp_lib.__all__}
