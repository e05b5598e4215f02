"""Tables by name: that a run may be interrupted, what it says of failures, and what it stores."""

import json
import zlib
from dataclasses import replace

import numpy as np
import pytest

from gvp_book.experiments import alignment, grasping
from gvp_book.results import read_result
from gvp_book.tables import TABLES, Settings, reproduce
from gvp_lib.errors import GvpError, JournalError, UnknownNameError

pytestmark = pytest.mark.check

CASE = ("cuboid_1x2", "flat")
SWEEPS = {"step=40mm": ({"planner": {"step": 0.040}}, (CASE,))}


def made_up(job):
    """A row that depends on its job alone, without a simulator."""
    rng = np.random.default_rng(zlib.crc32(json.dumps(job, sort_keys=True).encode()))
    judged = {"outcome": "aligned", "about_x": 1.0, "about_y": 0.0, "roll": 1.0, "frames": 9, "views": 4, "seconds": 3}
    return {"start": {"tilt": 20.0}, **{name: {**judged, "total": float(rng.uniform(0, 9))} for name in job["methods"]}}


class Episodes:
    """Made-up episodes, counted: those of start ``wrong`` fail, and number ``last`` is interrupted."""

    def __init__(self, wrong=None, last=None):
        self.wrong, self.last, self.jobs = wrong, last, []

    def __call__(self, job):
        self.jobs.append(job)
        if len(self.jobs) == self.last:
            raise KeyboardInterrupt
        if job["k"] == self.wrong:
            raise ZeroDivisionError("by nought")
        return made_up(job)


@pytest.fixture
def small(monkeypatch):
    """One case and one sweep, with made-up rows."""

    def run(folder, once=None, starts=3, **options):
        monkeypatch.setitem(TABLES, "table-3.1", replace(alignment.EXPERIMENT, once=once or Episodes()))
        return reproduce("table-3.1", Settings(starts, folder=folder, progress=False, **options))

    monkeypatch.setattr(alignment, "CASES", (CASE,))
    monkeypatch.setattr(alignment, "SWEEPS", SWEEPS)
    return run


def test_a_table_is_stored_with_its_command_its_rows_and_their_summary(small, tmp_path):
    path = small(tmp_path / "results", seed=7)
    result = read_result(path)
    assert (result["name"], result["seeds"], result["replayed"]) == ("table-3.1", [7], "its first episodes")
    assert result["command"] == "gvp reproduce table-3.1 --starts 3 --seed 7"
    content = result["content"]
    assert set(content) == {"thesis", "summary", "pooled", "sweeps", "floors", "rows"}
    assert content["thesis"]["cylinder"]["mean"] == 8.2
    assert set(content["sweeps"]) == {"step=40mm/cuboid_1x2/flat"}
    totals = content["rows"]["thesis/cuboid_1x2/flat"]["quartic"]["total"]
    error = content["summary"]["thesis/cuboid_1x2/flat"]["quartic"]["error"]
    assert error["n"] == len(totals) == 3
    assert error["mean"] == pytest.approx(np.mean(totals), abs=0.006)  # rows are kept to a hundredth
    assert 5 < content["floors"]["cuboid_1x2/flat"] < 10  # errata 22: 7.9 for the 1x2
    assert [file.name for file in path.parent.iterdir()] == ["table-3.1.json"]  # no journal is left


def test_an_interrupted_run_goes_on_where_it_was_unless_other_episodes_or_other_code_began_it(
    small, tmp_path, monkeypatch
):
    first, rest = Episodes(last=5), Episodes()
    with pytest.raises(KeyboardInterrupt):
        small(tmp_path, first)
    with pytest.raises(JournalError, match="another recipe"):
        small(tmp_path, seed=2)
    with monkeypatch.context() as patch:
        patch.setitem(SWEEPS, "step=40mm", ({"planner": {"step": 0.050}}, (CASE,)))  # under the same key
        with pytest.raises(JournalError, match="another recipe"):
            small(tmp_path)
    with pytest.raises(JournalError, match=r"written by other code: its job thesis/cuboid_1x2/flat/0, run again, has"):
        small(tmp_path, lambda job: {**made_up(job), "start": {"tilt": np.nextafter(20.0, 21.0)}})
    with pytest.raises(JournalError, match=r"(?s)run again, fails:.*by nought"):
        small(tmp_path, Episodes(wrong=0))
    assert not (tmp_path / "table-3.1.json").exists()
    assert small(tmp_path, rest, starts=4).read_bytes() == small(tmp_path / "whole", starts=4).read_bytes()
    assert len(rest.jobs) == 1 + 12 - 4  # more of them, too
    assert rest.jobs[0] == first.jobs[0]  # again, to see that the code is the same


def test_episodes_that_failed_are_reported_and_only_they_are_run_again(small, tmp_path):
    broken, again = Episodes(wrong=1), Episodes()
    text = r"(?s)^3 of 9 episodes failed, the first of them thesis/cuboid_1x2/flat/1:.*ZeroDivisionError: by nought"
    with pytest.raises(GvpError, match=rf"{text}.*The others are kept; the same command tries these again$"):
        small(tmp_path, broken)
    assert len(broken.jobs) == 9  # a failure does not keep the others from being run
    small(tmp_path, again)
    assert [job["k"] for job in again.jobs] == [0, 1, 1, 1]


def test_table_3_2_is_stored_with_every_method_that_was_run(tmp_path, monkeypatch):
    common = {"plan": "aligned", "outcome": "held", "error": 1.0, "roll": 0.5, "frames": 30, "seconds": 10.0}
    held = {**common, "success": True, "shaken": True, "deepest": 0.5, "fastest": 0.2}

    def once(job):
        return {"tilt": 20.0, **dict.fromkeys(job["methods"], held)}

    monkeypatch.setitem(TABLES, "table-3.2", replace(grasping.EXPERIMENT, once=once))
    monkeypatch.setattr(grasping, "CASES", (CASE,))
    monkeypatch.setattr(grasping, "PLACING", (("cylinder", "ramp"),))
    content = read_result(reproduce("table-3.2", Settings(16, folder=tmp_path, progress=False)))["content"]
    assert set(content["summary"]) == {"thesis/cuboid_1x2/flat", "none/cuboid_1x2/flat", "placing/cylinder/ramp"}
    counts = [content["summary"]["thesis/cuboid_1x2/flat"][method]["n"] for method in grasping.METHODS]
    assert counts == [4, 1, 1, 4, 16, 2, 2, 2, 2]
    placed = content["summary"]["placing/cylinder/ramp"]
    assert {name: each["n"] for name, each in placed.items() if name in grasping.METHODS} == {
        "ours": 4, "look_down": 4, "moments": 2, "stay": 2, "random": 2, "oracle": 2
    }  # fmt: skip


def test_an_unknown_table_is_refused_and_the_known_ones_are_named(tmp_path):
    known = r"no table or figure named 'table-9\.9'.*Known: .*figure-3\.3, .*table-3\.1, table-3\.2"
    with pytest.raises(UnknownNameError, match=known):
        reproduce("table-9.9", Settings(folder=tmp_path))
    assert not any(tmp_path.iterdir())
