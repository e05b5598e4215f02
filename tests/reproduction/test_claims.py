"""The thesis's claims: their numbers are the stored results', and their verdicts follow from their rules."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from gvp_book.claims.claim import (
    Claim,
    Found,
    Measured,
    Verdict,
    above,
    agrees,
    at_most,
    below,
    more_than,
    no_worse,
)
from gvp_book.claims.listing import CLAIMS, SECTIONS, Results, judge, judge_all, summary
from gvp_book.plots.claims import claims_table, summary_table
from gvp_book.tables import TABLES
from gvp_lib.errors import InvalidParameterError, ResultError

pytestmark = pytest.mark.check

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "book" / "results"


@pytest.fixture(scope="module")
def judged():
    return judge_all(Results(RESULTS))


def found(judged, says):
    (each,) = [each.found for each in judged if each.claim.says == says]
    return each


def content(name):
    return json.loads((RESULTS / f"{name}.json").read_text("utf-8"))["content"]


def test_every_claim_is_judged_in_the_thesiss_order_and_says_why(judged):
    assert [each.claim for each in judged] == list(CLAIMS)
    sections = [list(SECTIONS).index(each.claim.section) for each in judged]
    assert sections == sorted(sections)
    for each in judged:
        assert (each.found.why if each.found else each.claim.why).endswith(".")
        assert (each.found is None) == (each.verdict is Verdict.CHAPTER)
        assert len(each.commands) == len(each.claim.results)
        assert all(name in TABLES for name in each.claim.results)


def test_every_cell_of_the_thesiss_tables_is_a_claim():
    count = {name: sum(claim.place == name for claim in CLAIMS) for name in dict.fromkeys(c.place for c in CLAIMS)}
    assert [count[f"Table 3.{k}"] for k in (1, 2, 3, 4)] == [4, 15, 2, 3]


@pytest.mark.parametrize(("target", "name"), [("cuboid_1x1", "1x1 brick"), ("cylinder", "can")])
def test_cells_of_table_3_1_are_the_means_of_the_stored_episodes(judged, target, name):
    rows = content("table-3.1")["rows"]
    told = found(judged, f"Angle error on the {name}")
    for method, measured in (("quartic", told.ours), ("silhouette", told.better)):
        errors = [e for place in ("flat", "raised") for e in rows[f"thesis/{target}/{place}"][method]["total"]]
        assert (measured.value, measured.sd, measured.n) == pytest.approx(
            (np.mean(errors), np.std(errors, ddof=1), len(errors))
        )
        assert measured.low < measured.value < measured.high


def test_cells_of_table_3_2_are_the_stored_counts(judged):
    summary_ = content("table-3.2")["summary"]
    for number, place in enumerate(("flat", "side"), 1):
        told = found(judged, f"Grasps of the can, orientation {number}")
        for method, measured in (("thesis", told.ours), ("ours", told.better)):
            stored = summary_[f"thesis/cylinder/{place}"][method]
            ends = [100 * stored["interval"][end] for end in ("low", "high")]
            assert (measured.value, measured.n) == pytest.approx((100 * stored["rate"], stored["n"]))
            assert (measured.low, measured.high) == pytest.approx(ends, abs=0.01)


@pytest.mark.parametrize(("says", "name", "case"), [
    ("Final error on the 1x2 brick", "table-3.3", "clean/cuboid_1x2"),
    ("Final error on the soup carton", "table-3.3", "clean/tomato_soup_box"),
    ("Final error on the 1x1 brick, trained on the 1x2", "table-3.4", "clean/cuboid_1x1 in blue"),
    ("Final error on the can, trained on the 1x2", "table-3.4", "clean/cylinder"),
])  # fmt: skip
def test_cells_of_tables_3_3_and_3_4_are_the_stored_summaries(judged, says, name, case):
    stored, told = content(name)["summary"][case]["random, ResNet-50"]["error"], found(judged, says).ours
    interval = (stored["interval"]["low"], stored["interval"]["high"])
    assert (told.value, told.sd, told.n, told.low, told.high) == (stored["mean"], stored["sd"], stored["n"], *interval)


def test_a_table_without_resnet_50_goes_by_the_small_network_and_says_so(tmp_path):
    def made_on_a_small_machine(stored):
        for part in ("summary", "rows"):
            for methods in stored[part].values():
                for name in [name for name in methods if "ResNet-50" in name]:
                    del methods[name]

    results = changed(tmp_path / "r", "table-3.3", made_on_a_small_machine)
    told = found(judge_all(results), "Final error on the 1x2 brick")
    assert told.ours.value == content("table-3.3")["summary"]["clean/cuboid_1x2"]["random"]["error"]["mean"]
    assert "smaller than the thesis's" in told.why


def test_shares_of_failures_are_those_of_the_stored_causes(judged):
    told = found(judged, "Most failures come from the noisy IR sensor, not from the alignment").ours
    stored = content("table-3.2")["pooled_thesis_placements"]["thesis"]["thesis"]
    assert told.n == stored["n"] - stored["successes"] == sum(stored["causes"].values())
    assert told.value == pytest.approx(100 * sum(v for k, v in stored["causes"].items() if "IR" in k) / told.n)


def changed(folder, name, change):
    """A copy of the results with one of them changed."""
    shutil.copytree(RESULTS, folder, ignore=shutil.ignore_patterns(".*"))
    result = json.loads((folder / f"{name}.json").read_text("utf-8"))
    change(result["content"])
    (folder / f"{name}.json").write_text(json.dumps(result), "utf-8")
    return Results(folder)


FIVE = next(claim for claim in CLAIMS if claim.printed == "5 deg")


def test_a_changed_result_changes_what_is_printed_and_the_verdict(tmp_path, judged):
    def worse(stored):
        error = stored["summary"]["clean/cuboid_1x2"]["random, ResNet-50"]["error"]
        error |= {"mean": 7.25, "interval": {"low": 6.5, "high": 8.0}}

    told = judge(FIVE, changed(tmp_path / "r", "table-3.3", worse))
    before = next(each for each in judged if each.claim is FIVE)
    assert (before.verdict, told.verdict) == (Verdict.HOLDS, Verdict.FAILS)
    assert str(told.found.ours).startswith("7.2 ")
    assert str(claims_table([told])) != str(claims_table([before]))


def test_a_claim_without_its_result_fails_and_says_what_to_compute(tmp_path):
    with pytest.raises(ResultError, match=r"table-3\.3"):
        judge(FIVE, Results(tmp_path))
    lacking = changed(tmp_path / "r", "table-3.3", lambda stored: stored["summary"].clear())
    with pytest.raises(ResultError, match=r"lacks what .* Compute it anew: gvp reproduce table-3\.3"):
        judge(FIVE, lacking)


def test_rules_know_what_an_interval_allows():
    low, wide, high = Measured(2, 9, 1, 3), Measured(3, 9, 0, 6), Measured(5, 9, 4.5, 6)
    assert [at_most(4, "deg").judge(m, None) for m in (low, wide, high)] == [
        Verdict.HOLDS, Verdict.OPEN, Verdict.FAILS]  # fmt: skip
    assert [more_than(4, "deg").judge(m, None) for m in (low, wide, high)] == [
        Verdict.FAILS, Verdict.OPEN, Verdict.HOLDS]  # fmt: skip
    assert [below("").judge(m, high) for m in (low, wide, high)] == [Verdict.HOLDS, Verdict.OPEN, Verdict.OPEN]
    assert [above("").judge(m, low) for m in (low, wide, high)] == [Verdict.OPEN, Verdict.OPEN, Verdict.HOLDS]
    assert [agrees().judge(m, high) for m in (low, wide)] == [Verdict.FAILS, Verdict.HOLDS]
    for larger, verdict in ((True, Verdict.FAILS), (False, Verdict.BETTER)):
        assert no_worse(larger_is_better=larger).judge(low, high) is verdict
    with pytest.raises(InvalidParameterError, match="held against"):
        below("").judge(low, None)


def test_a_claim_is_measured_or_says_why_it_is_not():
    with pytest.raises(InvalidParameterError, match="or says why"):
        Claim("4", "text", "It flies", "", "00_tour", ("table-3.1",), why="It has wings.")
    with pytest.raises(InvalidParameterError, match="or says why"):
        Claim("4", "text", "It flies", "", "00_tour", measure=lambda stored: Found(Measured(1.0), "."))


def test_the_readme_has_the_table_that_the_stored_results_print(judged):
    readme = (ROOT / "README.md").read_text("utf-8")
    told = readme.partition("gvp claims --summary`; a test compares. -->\n\n")[2].partition("\n\n<!--")[0]
    assert told == str(summary_table(summary(judged))), "write what `gvp claims --summary` prints into README.md"
