"""What the experiment on photographs tells, of the few starts that are run again."""

import golden
import pytest

from gvp_book.experiments.desk import desk_jobs, desk_report
from gvp_book.experiments.photographs import PACKAGES


@pytest.fixture(scope="module")
def report():
    return desk_report(golden.read("photographs")[1])


def test_every_package_stands_on_the_sheet_and_on_the_bare_desk_from_starts_of_its_own():
    jobs = desk_jobs(seed=2020, starts=2)
    assert len(jobs) == 2 * len(PACKAGES) * 2
    assert jobs["sheet/can/0"]["seed"] != jobs["sheet/can/1"]["seed"]


def test_the_summary_is_of_solids_that_explain_and_of_every_silhouette(report):
    tea = report["sheet"]["tea"]
    assert tea == report["sheet"]["all"]
    assert tea["n"] == 3
    assert tea["explains"] == tea["kind"] == 1.0
    assert tea["error"]["median"] <= 1.0
    assert tea["error"]["worst"] <= 3.0
    assert tea["sizes"]["median"] <= 2.0
    assert tea["iou"]["worst"] > 0.9
    assert tea["iou"]["median"] > 0.97


def test_what_learns_or_is_given_a_box_beats_one_hue(report):
    bare = {name: row["tea"]["mean"] for name, row in report["bare"].items()}
    assert bare["learned"] > 0.95
    assert bare["learned"] >= bare["box, GrabCut"] > bare["one hue, whole"] > bare["one hue"]


def test_a_start_without_a_solid_or_without_a_sheet_counts_and_is_not_explained(report):
    rows = {
        **report["rows"],
        "sheet/tea/7": {"not found": "no"},
        "sheet/tea/8": {"views": 9, "iou": [0.9], "explains": False},
    }
    tea = desk_report(rows)["sheet"]["tea"]
    assert tea["n"] == 5
    assert tea["explains"] == 0.6
    assert tea["iou"]["worst"] == 0.9
