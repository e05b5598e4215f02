"""Tables of the stored experiment, made of a small result."""

from gvp_book.plots.tables import alignment_table, first_arc_effect, pooled_table, sweep_table


def told(mean, n=4, views=30.0, **outcomes):
    error = {"n": n, "mean": mean, "median": mean / 2, "p95": 2 * mean, "interval": {"low": mean - 1, "high": mean + 1}}
    return {"error": error, "arrived": {**error, "mean": mean / 4}, "views": views, "outcomes": outcomes}


CONTENT = {
    "thesis": {"cuboid_1x2": {"mean": 12.4, "sd": 4.2}},
    "summary": {
        f"{group}/cuboid_1x2/{placement}": {
            "quartic": told(10.0, **{"aligned": 1, "any angle": 1, "collision": 2}),
            "silhouette": told(2.0, aligned=4),
        }
        for group in ("thesis", "none")
        for placement in ("flat", "tilted")
    },
    "pooled": {"thesis": {"quartic": told(8.0), "quartic - silhouette": {"mean": 6.0}}},
    "sweeps": {
        "step/cuboid_1x1/flat": {"quartic": told(9.0), "silhouette": told(1.0), "unchanged": {"quartic": told(7.0)}},
        "step/cuboid_1x2/flat": {"quartic": told(5.0), "silhouette": told(3.0), "unchanged": {"quartic": told(3.0)}},
        "own/cuboid_1x2/flat": {"full": told(0.5, views=20.0), "unchanged": {"silhouette": told(0.6)}},
    },
    "rows": {
        "none/cuboid_1x2/flat": {"quartic": {"first_arc": [1.0, -2.0, -9.0, None], "total": [2.0, 4.0, 20.0, 99.0]}},
        "none/cylinder/flat": {"quartic": {"first_arc": [1.0], "total": [70.0]}},
        "thesis/cuboid_1x2/flat": {"quartic": {"first_arc": [1.0], "total": [70.0]}},
    },
}


def test_a_case_shows_mean_interval_and_median_and_counts_what_failed():
    flat, tilted = alignment_table(CONTENT).rows
    assert flat == ["cuboid_1x2, flat", "12.4", "10.0 [9.0, 11.0], 5.0", "2", "2.0 [1.0, 3.0], 1.0", "0", "4"]
    assert tilted[1] == "", "the thesis tilted nothing"


def test_pooled_rows_are_methods_and_no_differences():
    assert pooled_table(CONTENT).rows == [["quartic", "4", "8.00", "2.00", "4.00", "16.0", "30"]]


def test_a_sweep_is_averaged_over_its_objects_and_may_lack_an_estimator():
    step, own = sweep_table(CONTENT).rows
    # Two intervals of plus and minus 1, each of half the mean: plus and minus the root of a half.
    assert step == ["step", "8", "5.0 [4.3, 5.7]", "7.0 [6.3, 7.7]", "", "2.0 [1.3, 2.7]", "30"]
    assert own == ["own", "4", "", "", "0.6 [-0.4, 1.6]", "0.5 [-0.5, 1.5]", "20"]


def test_a_variation_is_told_in_words():
    one = {"focal length +-5%/cuboid_1x2/flat": {"quartic": told(1.0), "silhouette": told(1.0), "unchanged": {}}}
    (row,) = sweep_table({"sweeps": one}).rows
    assert row[0] == "focal length ±5 %"


def test_the_first_arc_is_counted_by_the_size_of_its_error_on_bricks_alone():
    good, bad = first_arc_effect(CONTENT).rows
    assert good[:2] == ["within 5 deg", "2"]
    assert good[2].startswith("3.0 [2.0, ")
    assert bad == ["off by 5 deg or more", "1", "20.0 [nan, nan]"], "one plan tells nothing of its scatter"
