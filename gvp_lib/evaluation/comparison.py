"""Anybody's planners side by side, from the same starts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError, UnknownNameError
from gvp_lib.evaluation.episodes import Judgement, begin, begin_again, run_episode
from gvp_lib.evaluation.statistics import Summary, paired_difference, summarize
from gvp_lib.motion.arm import Outcome
from gvp_lib.picture import Pictured, count
from gvp_lib.planning.plan import ViewpointPlanner
from gvp_lib.simulation.workcell import WorkCell

__all__ = ["Comparison", "compare"]


@dataclass(frozen=True, eq=False)
class Comparison(Pictured):
    """Judgements of several planners from the same starts; ``print`` shows them as a table.

    Attributes
    ----------
    judgements
        For each planner, a judgement of each start, in order.
    """

    _figure = "plot_comparison"

    judgements: Mapping[str, tuple[Judgement, ...]]

    @cached_property
    def errors_deg(self) -> dict[str, NDArray[np.float64]]:
        """True viewpoint errors of each planner, shape (starts,), deg."""
        return {name: np.array([each.total for each in found]) for name, found in self.judgements.items()}

    @cached_property
    def summaries(self) -> dict[str, Summary]:
        """Statistics of each planner's errors, deg."""
        return {name: summarize(errors) for name, errors in self.errors_deg.items()}

    @checked
    def difference(self, planner: str, other: str) -> Summary:
        """Compare two planners start by start.

        Parameters
        ----------
        planner, other
            Names of the two, as they were given.

        Returns
        -------
        Summary
            Statistics of ``planner``'s error less ``other``'s, deg: the mean is negative where ``planner`` is better.
        """
        for name in (planner, other):
            if name not in self.judgements:
                raise UnknownNameError("planner", name, self.judgements)
        return paired_difference(self.errors_deg[planner], self.errors_deg[other])

    def __str__(self) -> str:
        width = max(len("planner"), *map(len, self.judgements))
        lines = [f"{'planner':{width}}  mean deg [95 % interval]   median    worst  arrived  pictures"]
        for name, found in self.judgements.items():
            errors, mean = self.errors_deg[name], self.summaries[name]
            interval = f"{mean.mean:6.2f} [{mean.interval.low:.2f}, {mean.interval.high:.2f}]"
            arrived = sum(Outcome(each.outcome).arrived for each in found)
            lines.append(
                f"{name:{width}}  {interval:24} {np.median(errors):8.2f} {errors.max():8.2f} "
                f"{arrived:4}/{len(found):<3} {np.mean([each.frames for each in found]):8.0f}"
            )
        return "\n".join(lines)

    def __repr__(self) -> str:
        starts = len(next(iter(self.judgements.values())))
        means = ", ".join(f"{name} {summary.mean:.2f}" for name, summary in self.summaries.items())
        means = means if len(means) <= 100 else f"{means[:97]}..."
        return f"Comparison({count(starts, 'start')}, mean error in deg: {means})"


@checked
def compare(
    planners: Mapping[str, ViewpointPlanner], cell: WorkCell, starts: int | Iterable[int] = 20, *, seed: int = 2020
) -> Comparison:
    """Run planners from the same starts in a cell, and judge each by the truth.

    With the default seed, start k of a cell is start k of Tables 3.1 and 3.2, whatever the noise, 0.25 to 0.35 m from
    the object. The cell is left where the last planner stopped.

    Parameters
    ----------
    planners
        Anything with a method ``plan(arm)``, by name: yours, :class:`gvp_lib.RobustPlanner`, :class:`LookDown`, ...
    cell
        Work cell, which says what the arm, the object, its placement and the noise are.
    starts
        Number of starts, or the numbers of some, from 0.
    seed
        Seed of all starts.

    Raises
    ------
    InvalidParameterError
        There are no planners or no starts, or something cannot plan.

    Examples
    --------
    >>> from gvp_lib import WorkCell
    >>> from gvp_lib.evaluation import Stay
    >>> from gvp_lib.planning import LookDown
    >>> cell = WorkCell(arm="floating", target="cuboid_1x2")
    >>> found = compare({"stay": Stay(cell.segmenter), "down": LookDown(cell.segmenter)}, cell, starts=3)
    >>> found.errors_deg["down"].shape, found.difference("down", "stay").mean < 0
    ((3,), True)
    """
    numbers = range(starts) if isinstance(starts, int | np.integer) else starts
    numbers = list(numbers) if isinstance(numbers, Iterable) else []
    whole = all(isinstance(k, int | np.integer) and k >= 0 for k in numbers) and len({*numbers}) == len(numbers)
    if not (isinstance(planners, Mapping) and planners and numbers and whole):
        raise InvalidParameterError(
            "give planners by their names, at least one, and how many starts, or their numbers from 0, each once; got "
            f"{planners!r} and {starts!r}"
        )
    for name, planner in planners.items():
        if isinstance(planner, type) or not isinstance(planner, ViewpointPlanner):
            raise InvalidParameterError(
                f"a planner is an object with a method plan(arm), such as LookDown(cell.segmenter); {name!r} is "
                f"{planner!r}"
            )
    found: dict[str, list[Judgement]] = {name: [] for name in planners}
    for k in numbers:
        start = begin(cell, k, seed)
        for name, planner in planners.items():
            begin_again(cell, start)
            _, judged = run_episode(cell, planner)
            found[name].append(judged)
    return Comparison({name: tuple(each) for name, each in found.items()})
