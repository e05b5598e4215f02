"""The thesis's claims: their numbers are the stored results', and their verdicts follow from their rules."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from gvp_book.claims.claim import Measured, Rule, Verdict
from gvp_book.claims.headlines import headlines_table
from gvp_book.claims.listing import CLAIMS, SECTIONS, Results, claims_table, judge, judge_all
from gvp_lib.errors import InvalidParameterError, ResultError

pytestmark = pytest.mark.check

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "book" / "results"
FIVE = next(claim for claim in CLAIMS if claim.printed == "5 deg")


@pytest.fixture(scope="module")
def judged():
    return judge_all(Results(RESULTS))


def found(judged, says):
    (each,) = [each.found for each in judged if each.claim.says == says]
    return each


def content(name):
    return json.loads((RESULTS / f"{name}.json").read_text("utf-8"))["content"]


def changed(folder, name, change):
    """A copy of the results with one of them changed."""
    shutil.copytree(RESULTS, folder, ignore=shutil.ignore_patterns(".*"))
    result = json.loads((folder / f"{name}.json").read_text("utf-8"))
    change(result["content"])
    (folder / f"{name}.json").write_text(json.dumps(result), "utf-8")
    return Results(folder)


def test_every_claim_is_judged_in_the_thesiss_order_and_says_why(judged):
    assert [each.claim for each in judged] == list(CLAIMS)
    sections = [list(SECTIONS).index(each.claim.section) for each in judged]
    assert sections == sorted(sections)
    for each in judged:
        assert (each.found.why if each.found else each.claim.why).endswith(".")
        assert (each.found is None) == (each.verdict is Verdict.CHAPTER)
        assert [command.split()[2] for command in each.commands] == list(each.claim.results)
    places = [claim.place for claim in CLAIMS]  # every cell of the thesis's tables is a claim
    assert [places.count(f"Table 3.{k}") for k in (1, 2, 3, 4)] == [4, 15, 2, 3]


def test_cells_of_table_3_1_are_the_means_of_the_stored_episodes(judged):
    rows, cell = content("table-3.1")["rows"], found(judged, "Angle error on the can")
    for method, measured in (("quartic", cell.ours), ("ours", cell.better)):
        errors = [e for place in ("flat", "raised") for e in rows[f"thesis/cylinder/{place}"][method]["total"]]
        expected = np.mean(errors), np.std(errors, ddof=1), len(errors)
        assert (measured.value, measured.sd, measured.n) == pytest.approx(expected)
        assert measured.low < measured.value < measured.high


def test_cells_of_table_3_2_are_the_stored_counts(judged):
    cell = found(judged, "Grasps of the can, orientation 2")
    for method, measured in (("thesis", cell.ours), ("ours", cell.better)):
        stored = content("table-3.2")["summary"]["thesis/cylinder/side"][method]
        assert (measured.value, measured.n) == pytest.approx((100 * stored["rate"], stored["n"]))
        ends = [100 * stored["interval"][end] for end in ("low", "high")]
        assert (measured.low, measured.high) == pytest.approx(ends, abs=0.01)


@pytest.mark.parametrize(("says", "name", "case"), [
    ("Final error on the soup carton", "table-3.3", "clean/tomato_soup_box"),
    ("Final error on the 1x1 brick, trained on the 1x2", "table-3.4", "clean/cuboid_1x1 in blue"),
])  # fmt: skip
def test_cells_of_tables_3_3_and_3_4_are_the_stored_summaries(judged, says, name, case):
    stored, ours = content(name)["summary"][case]["random, ResNet-50"]["error"], found(judged, says).ours
    interval = (stored["interval"]["low"], stored["interval"]["high"])
    assert (ours.value, ours.sd, ours.n, ours.low, ours.high) == (stored["mean"], stored["sd"], stored["n"], *interval)


def test_a_table_without_resnet_50_goes_by_the_small_network_and_says_so(tmp_path):
    def made_on_a_small_machine(stored):
        for part in ("summary", "rows"):
            for methods in stored[part].values():
                for name in [name for name in methods if "ResNet-50" in name]:
                    del methods[name]

    results = changed(tmp_path / "r", "table-3.3", made_on_a_small_machine)
    cell = found(judge_all(results), "Final error on the 1x2 brick")
    assert cell.ours.value == content("table-3.3")["summary"]["clean/cuboid_1x2"]["random"]["error"]["mean"]
    assert "smaller than the thesis's" in cell.why


def test_shares_of_failures_are_those_of_the_stored_causes(judged):
    ours = found(judged, "Most failures come from the noisy IR sensor, not from the alignment").ours
    stored = content("table-3.2")["pooled_thesis_placements"]["thesis"]["thesis"]
    assert ours.n == stored["n"] - stored["successes"] == sum(stored["causes"].values())
    assert ours.value == pytest.approx(100 * sum(v for k, v in stored["causes"].items() if "IR" in k) / ours.n)


def test_a_changed_result_changes_what_is_printed_and_the_verdict(tmp_path, judged):
    def worse(stored):
        error = stored["summary"]["clean/cuboid_1x2"]["random, ResNet-50"]["error"]
        error |= {"mean": 7.25, "interval": {"low": 6.5, "high": 8.0}}

    after = judge(FIVE, changed(tmp_path / "r", "table-3.3", worse))
    before = next(each for each in judged if each.claim is FIVE)
    assert (before.verdict, after.verdict) == (Verdict.HOLDS, Verdict.FAILS)
    assert str(after.found.ours).startswith("7.2 ")
    assert str(claims_table([after])) != str(claims_table([before]))


def test_a_claim_without_its_result_fails_and_says_what_to_compute(tmp_path):
    with pytest.raises(ResultError, match=r"table-3\.3"):
        judge(FIVE, Results(tmp_path))
    lacking = changed(tmp_path / "r", "table-3.3", lambda stored: stored["summary"].clear())
    with pytest.raises(ResultError, match=r"lacks what .* Compute it anew: gvp reproduce table-3\.3"):
        judge(FIVE, lacking)


LOW, WIDE, HIGH = Measured(2, 9, 1, 3), Measured(3, 9, 0, 6), Measured(5, 9, 4.5, 6)


@pytest.mark.parametrize(("rule", "beside", "verdicts"), [
    (Rule.at_most(4, "deg"), None, "HOLDS OPEN FAILS"),
    (Rule.more_than(4, "deg"), None, "FAILS OPEN HOLDS"),
    (Rule.below(""), HIGH, "HOLDS OPEN OPEN"),
    (Rule.above(""), LOW, "OPEN OPEN HOLDS"),
    (Rule.agrees(), HIGH, "FAILS HOLDS HOLDS"),
    (Rule.no_worse(larger_is_better=True), HIGH, "FAILS HOLDS HOLDS"),
    (Rule.no_worse(larger_is_better=False), HIGH, "BETTER HOLDS HOLDS"),
])  # fmt: skip
def test_rules_know_what_an_interval_allows(rule, beside, verdicts):
    assert [rule.judge(measured, beside).name for measured in (LOW, WIDE, HIGH)] == verdicts.split()


def test_a_rule_that_compares_needs_something_to_compare_with():
    with pytest.raises(InvalidParameterError, match="held against"):
        Rule.below("").judge(LOW, None)


def test_the_readme_has_the_table_that_the_stored_results_print():
    readme = (ROOT / "README.md").read_text("utf-8")
    printed = readme.partition("gvp claims --summary`; a test compares. -->\n\n")[2].partition("\n\n<!--")[0]
    assert printed == str(headlines_table(Results(RESULTS))), "write what `gvp claims --summary` prints into README.md"
