"""Reach: the same viewpoints fixed and on a base, and a report that counts what it says it counts."""

import pytest

from gvp_book.experiments.reach import reach_jobs, reach_once, reach_report


def test_an_arm_sees_the_same_viewpoints_fixed_and_on_a_base_and_reaches_more_of_them_from_it():
    case = "0.3 m farther/"
    rows = {
        key: reach_once(job)
        for key, job in reach_jobs(2020, 3).items()
        if key.startswith("baxter/") and (case + "60/" in key or key.endswith(case + "30/0"))
    }
    for k in ("60/0", "60/1", "60/2"):
        fixed, base = (rows[f"baxter/{stand}/{case}{k}"] for stand in ("fixed", "base"))
        assert (fixed["tilt"], fixed["azimuth"]) == (base["tilt"], base["azimuth"])
        assert base["stands"]
        assert fixed["comes"] <= fixed["stands"]
        assert all(row["comes"] == (row["why"] == "") for row in (fixed, base))
        assert fixed["tilt"] <= 60
    assert not all(row["stands"] for key, row in rows.items() if "/fixed/" in key)
    assert len({row["azimuth"] for row in rows.values()}) == 4  # each cap and each start has a viewpoint of its own


def test_the_report_counts_by_case_with_wilsons_interval():
    row = {"tilt": 12.34, "azimuth": 56.78, "stands": True, "comes": False, "why": "collision"}
    came = {**row, "comes": True, "why": ""}
    content = reach_report({f"a/fixed/here/30/{k}": row if k else came for k in range(4)})
    told = content["summary"]["a/fixed/here/30"]
    assert (told["n"], told["stands"]["share"], told["comes"]["share"]) == (4, 1.0, 0.25)
    assert told["why"] == {"collision": 3}
    assert told["comes"]["interval"].low == pytest.approx(0.0456, abs=1e-3)
    assert content["rows"]["a/fixed/here/30"] == {
        "tilt": [12.3] * 4, "azimuth": [56.8] * 4, "stands": "1111", "comes": "1000"
    }  # fmt: skip
