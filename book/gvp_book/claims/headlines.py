"""The README's few results: of the thesis's planners, of ours, and of those who plan nothing or are told the pose."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gvp_book.claims.alignment import of_cases
from gvp_book.claims.claim import Measured
from gvp_book.claims.listing import CLAIMS, Results, judge
from gvp_book.plots.tables import Table

_PLANNED = "thesis", "ours"
_BESIDE = {
    "look_down": "straight down",
    "random": "a random view",
    "stay": "staying put",
    "oracle": "told the pose",
}
_NETWORKS = {
    "The network's camera off the 1x2's normal, trained on it": (
        "Final error on the 1x2 brick",
        ("table-3.3", "cuboid_1x2"),
    ),
    "The same off the 1x1's, painted in the 1x2's blue": (
        "Final error on the 1x1 brick, trained on the 1x2",
        ("table-3.4", "cuboid_1x1 in blue"),
    ),
}
"""Which claim says how far off, and where the result has those that stay."""


def headlines_table(results: Results) -> Table:
    """Each with its condition in the label; n stands in parentheses."""
    grasps, held = results["table-3.2"], results["table-3.2"]["pooled"]["thesis"]
    theirs, ours, plain = (of_cases(results, "cuboid_1x2", who) for who in ("quartic", "ours", "look_down"))
    rows = [
        ["Grasps held: bricks, can, alligator", *_rates(held)],
        ["The same, each with the other's rule for closing", _rate(held["quartic, sized"]),
         _rate(held["fit, threshold"]), ""],
        ["Held so that they can be placed: bricks, can, carton, leaning by 15 to 30 deg",
         *_rates(grasps["placing"]["tilted"], "placeable")],
        ["Camera off a 1x2 brick's normal", _off(theirs), _off(ours), f"{_BESIDE['look_down']} {plain.value:.2g}"],
    ]  # fmt: skip
    told = {says for says, _ in _NETWORKS.values()}
    found = {claim.says: judge(claim, results).found for claim in CLAIMS if claim.says in told}
    for label, (says, (name, target)) in _NETWORKS.items():
        ends, stay = found[says], results[name]["summary"][f"clean/{target}"]["stay"]["error"]["mean"]
        assert ends is not None
        assert ends.better is not None
        rows.append([label, _off(ends.ours), _off(ends.better), f"{_BESIDE['stay']} {stay:.2g}"])
    return Table(["what, and of what", "thesis's planner, reproduced", "ours", "beside them"], rows)


def _rates(told: Mapping[str, Any], of: str | None = None) -> list[str]:
    """Of the thesis's planner, of ours, and of those beside them, in per cent."""
    rates = {who: told[who] if of is None else told[who][of] for who in (*_PLANNED, *_BESIDE) if who in told}
    beside = [f"{name} {100 * rates[who]['rate']:.1f}" for who, name in _BESIDE.items() if who in rates]
    return [*(_rate(rates[who]) for who in _PLANNED), ", ".join(beside)]


def _rate(told: Mapping[str, Any]) -> str:
    return f"{100 * told['rate']:.1f} % ({told['n']})"


def _off(error: Measured) -> str:
    return f"{error.value:.2g} deg ({error.n})"
