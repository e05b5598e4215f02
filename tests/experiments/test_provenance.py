"""The hash of code: it changes with what a module runs, and with nothing else."""

from collections.abc import Callable
from pathlib import Path

import pytest

from gvp_lib.errors import InvalidParameterError
from gvp_lib.experiments import provenance
from gvp_lib.experiments.provenance import code_hash
from gvp_lib.experiments.tables import MODULES

SOURCE = {
    "__init__.py": "from gvp_lib.views.page import Page\nfrom gvp_lib.planning.plan import Plan as Plan",
    "experiments/__init__.py": "",
    "experiments/tables.py": "from gvp_lib.experiments import grasping",
    "experiments/grasping.py": "import numpy, gvp_lib.motion.arc as arc\nfrom gvp_lib.simulation import workcell, Cell",
    "simulation/__init__.py": "from .cell import Cell",
    "simulation/cell.py": "from ..geometry.camera import Camera",
    "simulation/workcell.py": "def late():\n    from gvp_lib.geometry import sphere",
    "simulation/unused.py": "",
    "simulation/models/arm.xml": "<mujoco/>",
    "geometry/camera.py": "from gvp_lib.geometry.sphere import Sphere",
    "geometry/sphere.py": "import gvp_lib.geometry.camera",
    "motion/__init__.py": "'The rooms on the way are run too.'",
    "motion/arc.py": "if TYPE_CHECKING:\n    from gvp_lib import motion\nelse:\n    from gvp_lib import Plan, errors",
    "planning/plan.py": "if typing.TYPE_CHECKING:\n    import gvp_lib.planning.cnn",
    "planning/cnn.py": "",
    "errors.py": "",
    "views/page.py": "",
}
GRASPING = "gvp_lib.experiments.grasping"


@pytest.fixture
def changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., bool]:
    """Whether the hash of modules of a small library changes with one of its files."""
    monkeypatch.setattr(provenance, "_ROOT", tmp_path)
    for place, text in SOURCE.items():
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).write_text(text)

    def try_it(place: str, modules: str | list[str] = GRASPING) -> bool:
        before, file = code_hash(modules), tmp_path / place
        file.parent.mkdir(exist_ok=True)
        file.write_text(SOURCE.get(place, "") + "\nchanged = 1")
        return code_hash(modules) != before

    return try_it


@pytest.mark.parametrize(
    "place",
    [
        "experiments/grasping.py",
        "experiments/__init__.py",
        "simulation/__init__.py",
        "simulation/workcell.py",  # from a room
        "simulation/cell.py",  # by its room, relatively
        "geometry/camera.py",
        "geometry/sphere.py",  # in a function
        "motion/__init__.py",
        "motion/arc.py",  # under another name
        "planning/plan.py",  # by a public name of the library
    ],
)
def test_what_a_module_imports_changes_its_hash(place: str, changes: Callable[..., bool]) -> None:
    assert changes(place)


@pytest.mark.parametrize(
    "place",
    [
        "__init__.py",
        "views/page.py",  # named by the library, as all is
        "experiments/tables.py",  # it imports the module
        "simulation/unused.py",
        "simulation/new.py",
        "planning/cnn.py",  # for type checkers alone
        "errors.py",  # imported, and decides no number
        "learning/weights.bin",
        "simulation/__pycache__/workcell.pyc",
    ],
)
def test_what_a_module_does_not_import_leaves_its_hash(place: str, changes: Callable[..., bool]) -> None:
    assert not changes(place)


@pytest.mark.parametrize(
    "text",
    [
        SOURCE["simulation/workcell.py"] + "  # why",
        '"""What it is."""\n\n\n' + SOURCE["simulation/workcell.py"],
        SOURCE["simulation/workcell.py"].replace("\n    ", '\n    """Two\n\n    lines — and ünïcode."""  # why\n    '),
    ],
)
def test_what_is_said_of_code_leaves_its_hash(text: str, changes: Callable[..., bool]) -> None:
    before, file = code_hash(GRASPING), provenance._ROOT / "simulation/workcell.py"
    file.write_text(text)
    assert code_hash(GRASPING) == before


@pytest.mark.parametrize("change", [(" late", " early"), ("sphere", "sphere\n    'ü'; x = '# no comment'")])
def test_what_code_does_changes_its_hash(change: tuple[str, str], changes: Callable[..., bool]) -> None:
    before, file = code_hash(GRASPING), provenance._ROOT / "simulation/workcell.py"
    file.write_text(SOURCE["simulation/workcell.py"].replace(*change))
    assert code_hash(GRASPING) != before
    changed = code_hash(GRASPING)
    file.write_text(file.read_text().replace("# no comment", "# another"))
    assert (code_hash(GRASPING) == changed) == ("# no" not in change[1])


@pytest.mark.parametrize("place", ["simulation/models/arm.xml", "simulation/models/new.xml"])
def test_a_model_counts_where_the_simulation_does(place: str, changes: Callable[..., bool]) -> None:
    assert not changes(place, "gvp_lib.motion.arc")
    (provenance._ROOT / place).unlink()
    assert changes(place)


def test_modules_that_import_each_other_have_one_hash(changes: Callable[..., bool]) -> None:
    assert code_hash("gvp_lib.geometry.camera") == code_hash("gvp_lib.geometry.sphere")
    assert changes("geometry/camera.py", "gvp_lib.geometry.sphere")


def test_several_modules_are_hashed_together_in_any_order(changes: Callable[..., bool]) -> None:
    both = ["gvp_lib.motion.arc", "gvp_lib.views.page"]
    assert code_hash(both) == code_hash(both[::-1]) != code_hash(both[0])
    assert changes("views/page.py", both)
    assert changes("motion/arc.py", both)


def test_where_the_library_lies_and_an_empty_room_do_not_matter(
    changes: Callable[..., bool], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = code_hash(GRASPING)
    (tmp_path / "experiments" / "__init__.py").unlink()
    assert code_hash(GRASPING) == before
    moved = tmp_path.rename(tmp_path.with_name("elsewhere"))
    monkeypatch.setattr(provenance, "_ROOT", moved)
    assert code_hash(GRASPING) == before


@pytest.mark.parametrize("module", ["gvp_lib.experiments.grapsing", "grasping", "numpy", "gvp_lib", ""])
def test_an_unknown_module_is_refused_and_the_nearest_are_named(module: str) -> None:
    with pytest.raises(InvalidParameterError, match=rf"no module '{module}' in gvp_lib.*Nearest are gvp_lib\.\w+"):
        code_hash(["gvp_lib.errors", module])


def test_no_module_at_all_is_refused() -> None:
    with pytest.raises(InvalidParameterError, match="one module or more; got none"):
        code_hash([])


@pytest.mark.parametrize("name", MODULES)
def test_what_stores_a_table_is_not_part_of_what_computes_it(name: str) -> None:
    found = set(provenance._closure(MODULES[name]))
    assert {*MODULES[name], "gvp_lib.simulation.workcell"} <= found
    assert ("gvp_lib.planning.silhouette" in found) == (name in ("table-3.1", "table-3.2"))
    storing = {f"gvp_lib.experiments.{module}" for module in ("tables", "results", "provenance")}
    assert not found & {*storing, "gvp_lib.jobs", "gvp_lib.cluster"}
