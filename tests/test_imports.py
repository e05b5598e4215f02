"""Who may know whom: the directions of the house, and what ``import gvp_lib`` may cost."""

import ast
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import gvp_book
import gvp_lib

pytestmark = pytest.mark.check

ROOT = Path(gvp_lib.__file__).parent
BOOK = Path(gvp_book.__file__).parent

# A room, the rooms it may know, and the outside packages it may use besides NumPy and SciPy. Every room may know
# `errors`. What is not in this table does not exist: a new room starts with a line here.
# fmt: off
HOUSE = {
    "__init__":    (set(),                                                            set()),
    "__main__":    ({"cli"},                                                          set()),
    "errors":      (set(),                                                            set()),
    "jobs":        (set(),                                                            {"tqdm", "distributed"}),
    # ground: the two ignore each other
    "geometry":    (set(),                                                            {"cv2"}),
    "perception":  (set(),                                                            {"cv2"}),
    # first and second floor: no simulator
    "motion":      ({"geometry", "perception"},                                       {"cv2"}),
    "planning":    ({"geometry", "perception", "motion"},                             {"cv2"}),
    # the wing, the only room that knows the truth
    "simulation":  ({"geometry", "perception", "motion"},                             {"cv2", "mujoco", "mink"}),
    # third floor: torch lives in `learning` alone
    "learning":    ({"geometry", "perception", "motion", "planning", "simulation", "jobs"},
                    {"cv2", "torch", "safetensors", "pyarrow", "gymnasium", "tqdm"}),
    "evaluation":  ({"geometry", "perception", "motion", "planning", "simulation"},   {"cv2"}),
    # the balcony: it sees everything, and nobody looks up to it
    "views":       ({"geometry", "perception", "motion", "planning", "simulation"},
                    {"cv2", "mujoco", "matplotlib", "cycler", "meshcat", "IPython", "ipywidgets", "tornado", "zmq",
                     "umsgpack", "PIL"}),
    "cli":         ({"doctor", "simulation", "learning", "jobs"},                     set()),
    "doctor":      (set(), {"mujoco", "OpenGL", "packaging", "torch", "jupyter_client"}),
    # the book, on its own ground: it uses the library as a stranger would
    "gvp_book":    ({"geometry", "perception", "motion", "planning", "simulation", "learning", "evaluation", "views",
                     "jobs", "cli"},
                    {"cv2", "matplotlib", "PIL"}),
}
# fmt: on
EVERYWHERE = {"numpy", "scipy"}
# Rooms above all others, which may use the public names as a user does.
FRONT_DOOR = {"learning", "views", "cli", "doctor", "gvp_book"}
HEAVY = {"torch", "mujoco", "mink", "cv2", "scipy", "matplotlib", "meshcat", "pyarrow", "gymnasium"}
SOURCES = {
    **{path.relative_to(ROOT): path for path in sorted(ROOT.rglob("*.py"))},
    **{path.relative_to(BOOK.parent): path for path in sorted(BOOK.rglob("*.py"))},
}
"""Files of the library by their place in it, and those of the book below ``gvp_book``."""


def room_of(module: Path) -> str:
    return module.parts[0].removesuffix(".py")


def imports_of(module: Path, source: str) -> set[str]:
    """Full names of what a module imports anywhere in it, in functions and for types too."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            here = [*([] if room_of(module) == "gvp_book" else ["gvp_lib"]), *module.parts[:-1]]
            base = here[: len(here) - node.level + 1] if node.level else []
            stem = ".".join([*base, *([node.module] if node.module else [])])
            # `from gvp_lib import motion` names a room; `from gvp_lib.motion import arm` names it by its stem.
            names.update(f"{stem}.{alias.name}" for alias in node.names)
    return names


def trespasses(module: Path, source: str) -> list[str]:
    """What a module imports although its room may not."""
    room = room_of(module)
    rooms, packages = HOUSE[room]
    found = []
    for name in sorted(imports_of(module, source)):
        top, *rest = name.split(".")
        if top == "gvp_lib":
            # A public name or the version, from the front door, is for those above every room.
            target = rest[0] if rest and rest[0] in HOUSE else "the front door"
            if target not in {room, "errors"} | rooms and not (target == "the front door" and room in FRONT_DOOR):
                found.append(f"{room} may not know {target} ({name})")
        elif top not in sys.stdlib_module_names | EVERYWHERE | packages | ({"gvp_book"} & {room}):
            found.append(f"{room} may not use {top} ({name})")
    return found


@pytest.mark.parametrize("module", SOURCES, ids=str)
def test_a_module_imports_only_what_its_room_may(module: Path) -> None:
    if module == Path("__init__.py"):  # for type checkers it names everything; what it loads is tested below
        return
    assert room_of(module) in HOUSE, f"{module}: a new room needs a line in HOUSE"
    assert trespasses(module, SOURCES[module].read_text("utf-8")) == []


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("geometry/x.py", "from gvp_lib.perception.moments import Blob"),
        ("geometry/x.py", "def f():\n    import torch"),
        ("perception/x.py", "from ..geometry import camera"),
        ("motion/x.py", "from gvp_lib.simulation import workcell"),
        ("planning/x.py", "import gvp_lib.simulation.workcell as w"),
        ("planning/x.py", "from gvp_lib import WorkCell"),
        ("simulation/x.py", "from gvp_lib.planning.plan import QuarticFit"),
        ("evaluation/x.py", "import torch.nn"),
        ("evaluation/x.py", "from gvp_book.results import read_result"),
        ("cli.py", "def f():\n    from gvp_book import cli"),
        ("gvp_book/x.py", "import mujoco"),
        ("learning/x.py", "from gvp_lib.views.figures import trace"),
        ("simulation/x.py", "from gvp_lib import cli"),
    ],
)
def test_the_rule_catches_a_trespass(module: str, source: str) -> None:
    assert len(trespasses(Path(module), source)) == 1


def test_no_room_knows_a_room_that_knows_it() -> None:
    for room, (known, _) in HOUSE.items():
        for other in known:
            assert room not in HOUSE[other][0], f"{room} and {other} know each other"


@pytest.mark.parametrize("room", [room for room in HOUSE if room not in ("__init__", "planning")])
def test_no_file_of_a_room_knows_one_that_knows_it_not_even_for_types(room: str) -> None:
    """Nor round a longer circle."""
    inside = {module: source for module, source in SOURCES.items() if room_of(module) == room}
    names = {".".join([*(() if room == "gvp_book" else ("gvp_lib",)), *m.with_suffix("").parts]): m for m in inside}
    known: dict[Path, set[Path]] = {module: set() for module in inside}
    for module, path in inside.items():
        for name in imports_of(module, path.read_text("utf-8")):
            known[module] |= {names[stem] for stem in (name, name.rpartition(".")[0]) if stem in names} - {module}
    try:
        TopologicalSorter(known).prepare()
    except CycleError as error:
        pytest.fail(" knows ".join(str(module) for module in reversed(error.args[1])))


def test_nobody_imports_the_balcony() -> None:
    for room, (known, _) in HOUSE.items():
        assert room == "gvp_book" or "views" not in known
        assert room in ("__main__", "gvp_book") or "cli" not in known


def loaded_by(statement: str) -> set[str]:
    """Top-level names of the modules that a statement loads in a fresh process."""
    program = f"{statement}\nimport sys\nprint(*sys.modules)"
    output = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    return {name.split(".")[0] for name in output.split()}


def test_importing_the_library_loads_nothing_heavy() -> None:
    loaded = loaded_by("import gvp_lib")
    assert "gvp_lib" in loaded
    assert loaded & HEAVY == set()


def test_the_command_line_starts_without_anything_heavy_either() -> None:
    assert loaded_by("import gvp_lib.cli, gvp_lib.doctor") & {*HEAVY, "numpy", "packaging"} == set()


@pytest.mark.parametrize("name", gvp_lib.__all__)
def test_every_public_name_resolves(name: str) -> None:
    assert getattr(gvp_lib, name) is not None
    assert name in dir(gvp_lib)


def test_an_unknown_public_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no_such_name"):
        gvp_lib.no_such_name  # noqa: B018


def test_type_checkers_are_told_of_every_public_name() -> None:
    tree = ast.parse((ROOT / "__init__.py").read_text("utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    told = {alias.name for node in block.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert told == set(gvp_lib.__all__) - {"__version__"}


def test_a_name_that_needs_an_extra_says_which() -> None:
    program = (
        "import sys; sys.modules['tornado'] = None\n"
        "import gvp_lib\n"
        "try: gvp_lib.Scene3D\n"
        "except gvp_lib.GvpError as error: print(type(error).__name__, error)"
    )
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert "MissingExtraError Scene3D needs tornado" in said
    assert "gvp_lib[notebooks]" in said
