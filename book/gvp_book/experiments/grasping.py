"""The experiment behind Table 3.2: from a start, by a planner, to an object in the hand. Thesis 3.1.3 to 3.1.7.

Planning touches nothing, so it runs without dynamics; the grasp has them. Each episode draws one start. From it the
thesis's planner runs and its grasp; the fit of silhouettes' moments concludes from the same views, and our grasp; then,
from the same start again, ours, and what there is to compare with.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cache, partial
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from gvp_book.results import Experiment, Row, noise_fields
from gvp_lib.errors import GvpError
from gvp_lib.evaluation.baselines import AlignInPlace, LookDown, Oracle, OracleGrasp
from gvp_lib.evaluation.episodes import begin, begin_again, draw_start
from gvp_lib.evaluation.statistics import paired_difference, summarize, wilson_interval
from gvp_lib.motion.arm import EyeInHandArm, Gripper, Hand, Outcome
from gvp_lib.planning.closing import SizedDepth
from gvp_lib.planning.grasp import Grasp, GraspExecutor
from gvp_lib.planning.image_moments import ImageMomentPlanner
from gvp_lib.planning.picking import Executor, RobustPlanner, pick_up
from gvp_lib.planning.plan import MIN_VIEWS, Plan, ViewpointPlanner
from gvp_lib.planning.silhouette import SilhouetteFit
from gvp_lib.planning.solids import FittedSolid
from gvp_lib.simulation.arms import ARMS
from gvp_lib.simulation.moving import record_contacts, shake
from gvp_lib.simulation.objects import OBJECTS
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import CellCache, WorkCell

THESIS_TRIALS = 10
THESIS: Mapping[str, tuple[int, int]] = {
    "cuboid_1x1": (8, 8),
    "cuboid_1x2": (10, 9),
    "cuboid_1x4": (9, 9),
    "cylinder": (9, 10),
    "alligator": (9, 8),
}
"""Table 3.2 as printed: successes in ten trials, in each of two placements."""

CASES: tuple[tuple[str, str], ...] = tuple(
    (target, placement)
    for target, second in zip(THESIS, ("side", "raised", "raised", "side", "raised"), strict=True)
    for placement in ("flat", second, "tilted")
)
"""Objects, in the thesis's two placements each as Fig. 3.1 shows them, and leaning on a block."""

PLACING: tuple[tuple[str, str], ...] = tuple(
    (target, placement)
    for placement in ("tilted", "steep", "ramp")
    for target in ("cuboid_1x1", "cuboid_1x2", "cuboid_1x4", "cylinder", "tomato_soup_box")
)
"""Where a hand that comes straight down holds an object askew, if it holds it; the first four are cases above, too."""

OPENINGS: Mapping[tuple[str, str], float] = {("cuboid_1x1", "side"): 0.056}
"""How wide the fingers are mounted to open, m, where the slots that suit the others (72 mm, 28 when shut) do not: a 1x1
on its side is 19 mm wide, and the fingers would meet nothing."""

METHODS = ("thesis", "fit, threshold", "quartic, sized", "moments", "ours", "look_down", "stay", "random", "oracle")
"""The thesis's planner and its plain threshold; version 0.1's fit of moments and our closing, in place of one of the
two, and of both; what :func:`gvp_lib.pick_up` does by default; the baselines, closing as ours."""

GROUPS: Mapping[str, list[str]] = {
    "ours": ["ours"],
    "thesis": ["thesis", "moments"],
    "none": ["thesis", "moments", "ours", "oracle"],
    "baselines": ["look_down", "stay", "random", "oracle"],
    "mixed": ["fit, threshold", "quartic, sized"],
    "placing": ["ours", "look_down"],
    "beside": ["moments", "stay", "random", "oracle"],
}
"""Methods of the groups of Table 3.2: of :data:`CASES`; the last two of those of :data:`PLACING` that are no such case.
All but ``none`` under the thesis's noise."""

_ON_ITS_VIEWS = ("thesis", "moments", "fit, threshold", "quartic, sized")  # they conclude from the thesis's arcs
_PLAIN = ("thesis", "fit, threshold")  # the fingers close by the thesis's threshold, not by size and filtered readings
_RANDOM_TILT = (0.0, 40.0)  # deg, of a random viewpoint
_BLOCK = 8


# --- the episodes -----------------------------------------------------------------------------------------------------


def grasping_jobs(seed: int, starts: int) -> dict[str, Row]:
    """Every episode of Table 3.2 under keys ``group/target/placement/k``.

    Ours runs from every start of a case (``ours``), in the further ones of :data:`PLACING` from a quarter, straight
    down beside it (``placing``). Whatever else there is runs from the first ones, so that all takes two hours on two
    cores.
    """
    quarter, eighth, sixteenth = starts // 4, starts // 8, starts // 16
    further = [case for case in PLACING if case not in CASES]

    def in_blocks(low: int, high: int) -> list[range]:
        return [range(k, min(k + _BLOCK, high)) for k in range(low, high, _BLOCK)]

    blocks = [  # in an order in which what a short run has is of every kind
        *((group, CASES, range(quarter)) for group in ("ours", "thesis")),
        ("placing", further, range(quarter)),
        ("baselines", CASES, range(eighth)),
        ("beside", further, range(eighth)),
        *((group, CASES, range(sixteenth)) for group in ("none", "mixed")),
        *(("ours", CASES, block) for block in in_blocks(quarter, starts)),
    ]
    return {
        f"{group}/{target}/{placement}/{k}": {
            "target": target, "placement": placement,
            "noise": noise_fields(Noise.none() if group == "none" else Noise.thesis()),
            "seed": seed, "k": k, "methods": GROUPS[group],
        }
        for group, cases, block in blocks
        for target, placement in cases
        for k in block
    }  # fmt: skip


def grasp_once(job: Mapping[str, Any]) -> Row:
    """One episode: a start, and for each method the row of :class:`JudgedGrasp`, with ``pictures`` and ``views`` of its
    plan; angles in deg, lengths in mm.

    A job has ``target``, ``placement``, ``noise`` (fields of :class:`Noise`), ``seed``, ``k`` (the number of the
    start), ``methods``, of :data:`METHODS`, and may have ``attempts``, how often each may try, but for those of the
    thesis's arcs; the row then says how often it did, and tells of the last one. Where the object does not come to
    rest, or the arm cannot look at it, that is what came of it: ``not begun``.
    """
    return grasp_in(grasp_cell, job)


def grasp_in(cell_of: Callable[[Mapping[str, Any]], WorkCell], job: Mapping[str, Any]) -> Row:
    """Run the episode of :func:`grasp_once` in another cell, of which a job has more to say."""
    try:
        cell = cell_of(job)
        cell.dynamic = False  # an episode that broke off may have left it on
        start = begin(cell, job["k"], job["seed"])
    except GvpError as error:
        if type(error) is not GvpError:  # something was given wrong
            raise
        return {"not begun": str(error)}
    planners = _planners(cell, job)
    row: Row = {"tilt": float(np.degrees(start.tilt))}
    for method in (name for name in METHODS if name in job["methods"]):
        if method in _ON_ITS_VIEWS:
            planners["thesis"].plan(cell.arm)  # its arcs, which others conclude from
        if method != "thesis":
            cell.dynamic = False
            begin_again(cell, start)
        executor = JudgedGrasp(cell, _executor(cell, method))
        attempts = 1 if method in ("thesis", *_ON_ITS_VIEWS) else job.get("attempts", 1)  # the thesis's has but one
        found = pick_up(
            cell.arm, cell.gripper, cell.segmenter,
            planner=planners.get(method), executor=executor, attempts=attempts,
        )  # fmt: skip
        row[method] = executor.row | {"pictures": found.plan.frames, "views": len(found.plan.views)}
        if "attempts" in job:
            row[method]["attempts"] = len(found.attempts) + 1
    cell.dynamic = False
    return row


def _executor(cell: WorkCell, method: str) -> Executor:
    if method == "oracle":
        return OracleGrasp(cell) if _odd(cell) else _OracleGrasp(cell)
    return GraspExecutor.thesis(cell.segmenter) if method in _PLAIN else GraspExecutor(cell.segmenter)


def _odd(cell: WorkCell) -> bool:
    """Whether the target is none of the thesis's, so that a face of its box may be no place to grasp it."""
    return cell.target_spec.name not in OBJECTS


@dataclass(frozen=True)
class _PlanBy:
    """A planner that is a function alone."""

    plan: Callable[[EyeInHandArm], Plan]


def _planners(cell: WorkCell, job: Mapping[str, Any]) -> dict[str, ViewpointPlanner]:
    """Who plans in an episode, each from its start; but ours, which is how :func:`gvp_lib.pick_up` plans by itself."""
    thesis = cache(partial(ImageMomentPlanner(cell.segmenter).plan, cell.arm))  # once; others go by what it saw
    estimator = SilhouetteFit(upright=True, lean=np.radians(20))
    minor = ImageMomentPlanner(cell.segmenter, estimator, wrist_retries=(np.pi / 2, -np.pi / 2))
    major = replace(minor, order="major first")
    rng = np.random.default_rng([job["seed"], job["k"]])

    def on_its_views(arm: EyeInHandArm) -> Plan:
        seen = thesis()  # so that the two differ in nothing else
        enough = sum(len(arc) for arc in seen.arcs) >= MIN_VIEWS
        first = _PlanBy(lambda arm: minor.conclude(arm, seen.arcs)) if enough else minor
        plan = RobustPlanner(cell.segmenter, (first, major, LookDown(cell.segmenter))).plan(arm)
        return replace(plan, frames=seen.frames + plan.frames)

    def where_it_ended(arm: EyeInHandArm) -> Plan:
        plan = thesis()
        if plan.joints is not None:
            arm.move_joints(plan.joints)
        return plan

    def anywhere(arm: EyeInHandArm) -> Plan:
        joints = arm.joints
        try:
            draw_start(cell, rng, _RANDOM_TILT)
        except GvpError as error:
            if type(error) is not GvpError:  # something was given wrong
                raise
            arm.move_joints(joints)  # no view to draw from is within reach: it stays where it began
        return AlignInPlace(cell.segmenter).plan(arm)

    return {
        "thesis": _PlanBy(lambda arm: thesis()),
        "fit, threshold": _PlanBy(on_its_views),
        "quartic, sized": _PlanBy(where_it_ended),
        "moments": _PlanBy(on_its_views),
        "look_down": LookDown(cell.segmenter),
        "stay": AlignInPlace(cell.segmenter),
        "random": _PlanBy(anywhere),
        "oracle": Oracle(cell, graspable=_odd(cell)),
    }


@dataclass(frozen=True)
class _OracleGrasp:
    """A grasp that knows the object's box."""

    cell: WorkCell

    def grasp(self, arm: EyeInHandArm, gripper: Gripper, plan: Plan | None = None) -> Grasp:
        return GraspExecutor(self.cell.segmenter, SizedDepth(_true_solid(self.cell))).grasp(arm, gripper, plan)


def _true_solid(cell: WorkCell) -> FittedSolid:
    """The object's box where it truly is against the camera, for a planner that knows."""
    truth, box = cell.truth, cell.target_spec.bounding_box()
    base_from_object = cell.arm.camera_pose() * truth.world_from_camera.inv() * truth.world_from_object
    turn = base_from_object.rotation * truth.world_from_object.rotation.inv()
    facing = truth.normal.nearest(-truth.world_from_camera.rotation.as_matrix()[:, 2])
    return FittedSolid(
        kind="box",
        base_from_solid=base_from_object * RigidTransform.from_translation(box.center),
        sizes=2 * box.half_extents,
        top=(0.0, 0.0),
        normal=turn.as_matrix() @ facing,
        uncertainty=0.0,
        residual=0.0,
        corrections=np.zeros((0, 6)),
    )


def grasp_cell(job: Mapping[str, Any]) -> WorkCell:
    """The work cell of a job, the fingers mounted for its object. The last one is kept, since jobs of one case follow
    each other."""
    target, placement, noise = job["target"], job["placement"], job["noise"]

    def make() -> WorkCell:
        arm = ARMS["baxter"]
        assert arm.gripper is not None
        opening = OPENINGS.get((target, placement), arm.gripper.max_width)
        fitted = replace(arm, gripper=replace(arm.gripper, max_width=opening))
        return WorkCell(fitted, target, placement, noise=Noise(**noise))

    return _kept.get((target, placement, tuple(sorted(noise.items()))), make)


_kept: CellCache[WorkCell] = CellCache()


# --- what came of a grasp, and why, by the truth ----------------------------------------------------------------------

LIFTED, HELD_FOR, TO_FALL = 0.05, 2.0, 0.3  # m and s of a success; s in which what was shaken loose has fallen


class Cause(StrEnum):
    """Why a grasp failed, by the truth, each as it stands in results."""

    TARGET_LOST = "target lost"
    UNREACHABLE = "unreachable"
    TOO_EARLY = "closed too early (IR)"
    NEVER_CLOSED = "never closed (IR)"
    MISALIGNED = "misaligned"
    PUSHED_AWAY = "pushed away"
    COLLISION = "collision"
    SLIPPED = "slipped"


@dataclass
class _Witness:
    """A gripper that hands everything on, and remembers the truth of the moment in which it had to close."""

    cell: WorkCell
    gripper: Gripper
    camera: RigidTransform | None = None
    target: RigidTransform | None = None
    error: float = np.nan  # rad
    roll: float = np.nan  # rad

    @property
    def width(self) -> float:
        return self.gripper.width

    @property
    def stroke(self) -> tuple[float, float]:
        return self.gripper.stroke

    @property
    def hand(self) -> Hand:
        return self.gripper.hand

    def open(self) -> None:
        self.gripper.open()

    def range(self) -> float:
        return self.gripper.range()

    def close(self) -> None:
        truth = self.cell.truth
        self.camera, self.target = truth.world_from_camera, truth.world_from_object
        self.error, self.roll = truth.viewpoint_error(), truth.roll_error()
        self.gripper.close()


@dataclass
class JudgedGrasp:
    """An executor whose grasp is judged: lifted, held, shaken; and what came of it, and why, in ``row``.

    ``error``, ``roll``: of the viewpoint, before the descent. ``success``: lifted by 5 cm and held for 2 s; ``shaken``:
    and after the shake. ``depth``: of the fingertips below the surface, as they closed; ``aside``: of the object from
    the middle, across the hand. ``tilt_in_hand``, ``turn_in_hand``, ``shift_in_hand``: between hand and object after
    the hold, against an aligned grasp through the object's center line.

    Planning touches nothing, so that the cell's dynamics begin with the grasp; they go on through further attempts, and
    the row is that of the last.
    """

    cell: WorkCell
    executor: Executor
    row: Row = field(default_factory=dict)

    def grasp(self, arm: EyeInHandArm, gripper: Gripper, plan: Plan | None = None) -> Grasp:
        """Grasp by the executor, and judge. See :class:`gvp_lib.planning.Executor`."""
        cell, truth = self.cell, self.cell.truth
        placed = truth.world_from_object
        error, roll = np.degrees(truth.viewpoint_error()), np.degrees(truth.roll_error())
        began = cell.time
        cell.dynamic = True
        witness = _Witness(cell, gripper)

        def lifted() -> bool:
            return bool(truth.world_from_object.translation[2] - placed.translation[2] >= LIFTED)

        with record_contacts(cell) as contacts:
            grasp = self.executor.grasp(arm, witness, plan)
            success = lifted()
            if success:
                cell.wait(HELD_FOR)
                success = lifted()
        row: Row = {
            "plan": plan.outcome.value if plan else None,
            "error": float(error),
            "roll": float(roll),
            "outcome": grasp.outcome.value,
            "success": success,
            "frames": grasp.frames,
            "seconds": float(cell.time - began),
            **_at_closing(cell, witness),
        }
        if success:
            x, _, _ = truth.world_from_camera.inv().apply(truth.world_from_object.translation)
            row["tilt_in_hand"] = float(np.degrees(truth.viewpoint_error()))
            row["turn_in_hand"] = float(np.degrees(abs(truth.roll_error())))
            row["shift_in_hand"] = 1000 * float(x)
            with record_contacts(cell) as shaken:
                shake(cell)
                cell.wait(TO_FALL)
            row["shaken"] = lifted()
            contacts.deepest = max(contacts.deepest, shaken.deepest)
            contacts.fastest = max(contacts.fastest, shaken.fastest)
        else:
            row["cause"] = _cause(grasp, row, witness, placed).value
        self.row = row | {"deepest": 1000 * contacts.deepest, "fastest": contacts.fastest}
        return grasp


def _at_closing(cell: WorkCell, witness: _Witness) -> dict[str, float]:
    """Where the object was as the fingers closed, mm."""
    if witness.camera is None or witness.target is None:
        return {}
    normal = cell.truth.normal.nearest(-witness.camera.rotation.as_matrix()[:, 2])
    # Half of the object's extent along a direction that is one of its axes, or across its round one.
    local = np.abs(witness.target.rotation.as_matrix().T @ normal)
    half_extent = float(np.linalg.norm(local * cell.target_spec.bounding_box().half_extents))
    surface = witness.camera.inv().apply(witness.target.translation + half_extent * normal)[2]
    x, y, _ = witness.camera.inv().apply(witness.target.translation)
    return {
        "depth": 1000 * float(witness.hand.tips - surface),
        "aside": 1000 * float(x),
        "along": 1000 * float(y),
    }


_BARELY, _TOO_TILTED, _TOO_TURNED = 5.0, 20.0, 20.0  # mm and deg, beyond which a grasp of these objects is chance
_TOO_FAR_ASIDE, _PUSHED, _TIPPED = 10.0, 10.0, 10.0  # mm, mm and deg
_NOT_SEEN = (Outcome.TARGET_LOST, Outcome.TARGET_NOT_FOUND, Outcome.TOO_WIDE)
_STOPPED = (Outcome.UNREACHABLE, Outcome.JOINT_LIMIT, Outcome.STALLED)


def _cause(grasp: Grasp, row: Row, witness: _Witness, placed: RigidTransform) -> Cause:
    """The first of the causes that holds, in the order in which they act."""
    outcome = grasp.outcome
    if outcome in _NOT_SEEN:
        return Cause.TARGET_LOST
    if outcome in _STOPPED and grasp.closed_at is None:
        return Cause.UNREACHABLE
    if row.get("depth", np.inf) < _BARELY and not grasp.landed:
        return Cause.TOO_EARLY
    tilted = max(row["error"], np.degrees(witness.error)) > _TOO_TILTED
    turned = abs(row["roll"]) > _TOO_TURNED or abs(np.degrees(witness.roll)) > _TOO_TURNED
    if tilted or turned or abs(row.get("aside", 0.0)) > _TOO_FAR_ASIDE:
        return Cause.MISALIGNED
    if outcome is Outcome.NEVER_CLOSED:
        return Cause.NEVER_CLOSED
    if witness.target is not None:
        moved = placed.inv() * witness.target
        if 1000 * np.linalg.norm(moved.translation) > _PUSHED or np.degrees(moved.rotation.magnitude()) > _TIPPED:
            return Cause.PUSHED_AWAY
    if grasp.landed or outcome in (Outcome.CONTACT, Outcome.COLLISION):
        return Cause.COLLISION
    return Cause.SLIPPED


# --- what they add up to ----------------------------------------------------------------------------------------------

_COMPARED = (("thesis", "ours"), ("moments", "ours"), ("thesis", "fit, threshold"), ("thesis", "quartic, sized"),
             ("ours", "oracle"), ("ours", "look_down"))  # fmt: skip
_AS_ALIGNED: Mapping[str, float] = {"tilt_in_hand": 5.0, "turn_in_hand": 5.0, "shift_in_hand": 5.0}  # deg, deg, mm


def placeable(grasp: Row) -> bool:
    """Whether a grasp held, through the shake too, and holds the object as an aligned one would.

    That is with tilt and turn in the hand of at most 5 deg each, and a shift of at most 5 mm: the thesis's "orientation
    that allows for easy placement thereafter".
    """
    aligned = all(abs(grasp.get(name, np.inf)) <= most for name, most in _AS_ALIGNED.items())
    return aligned and bool(grasp.get("shaken", False))


def grasping_report(rows: Mapping[str, Row]) -> Row:
    """The content of the stored result, of rows of :func:`grasp_once` under keys ``group/target/placement/k``; angles
    in deg, lengths in mm.

    ``thesis``: the printed table, with Wilson intervals. ``summary``: by group and case, for each method a
    :func:`tally`, and paired differences of success; the groups are ``thesis`` (its noise), ``none``, and ``placing``,
    the cases of :data:`PLACING` that are not in the first. ``pooled``: by group, over all cases; of ``placing`` over
    all of :data:`PLACING`. ``pooled_thesis_placements``: over those cases that the thesis has. ``placing``: by
    placement, over all objects of :data:`PLACING`. ``not begun``: why, of episodes in which nothing could be tried.
    ``contacts``: extremes over all episodes. ``rows``: every episode.
    """
    by_start: dict[str, dict[int, Row]] = {}
    for key, row in rows.items():
        group, target, placement, k = key.split("/")
        # What was compared ran from the same starts, under the same noise.
        group = {"none": "none", "placing": "placing", "beside": "placing"}.get(group, "thesis")
        by_start.setdefault(f"{group}/{target}/{placement}", {}).setdefault(int(k), {}).update(row)
    cases = {case: [found[k] for k in sorted(found)] for case, found in by_start.items()}
    every: dict[str, list[Row]] = {}
    level: dict[str, list[Row]] = {}
    placing: dict[str, list[Row]] = {}
    for case, found in cases.items():
        group, target, placement = case.split("/")
        if group != "placing":
            every.setdefault(group, []).extend(found)
            level.setdefault(group, []).extend([] if placement == "tilted" else found)
        if group != "none" and (target, placement) in PLACING:
            placing.setdefault(placement, []).extend(found)
    if placing:
        every["placing"] = [row for found in placing.values() for row in found]
    return {
        "thesis": {name: [trials(n, THESIS_TRIALS) for n in counts] for name, counts in THESIS.items()},
        "thesis_pooled": trials(sum(map(sum, THESIS.values())), 2 * THESIS_TRIALS * len(THESIS)),
        "summary": {case: _summary(found) for case, found in cases.items()},
        "pooled": {group: _summary(found) for group, found in every.items()},
        "pooled_thesis_placements": {group: _summary(found) for group, found in level.items()},
        "placing": {placement: _summary(found) for placement, found in placing.items()},
        "not begun": {key: row["not begun"] for key, row in rows.items() if "not begun" in row},
        "contacts": {group: _contacts(found) for group, found in every.items()},
        "rows": {case: columns(found) for case, found in cases.items()},
    }


def trials(successes: int, n: int) -> Row:
    """Successes in so many trials, with the Wilson interval of their rate."""
    return {"n": n, "successes": successes, "rate": successes / n, "interval": wilson_interval(successes, n)}


def by_method(group: Sequence[Row]) -> dict[str, list[Row]]:
    """Grasps of each method that any of the episodes has."""
    found = {method: [row[method] for row in group if method in row] for method in METHODS}
    return {method: grasps for method, grasps in found.items() if grasps}


def _summary(group: Sequence[Row]) -> Row:
    summary: Row = {method: tally(grasps) for method, grasps in by_method(group).items()}
    for a, b in _COMPARED:
        both = [(row[a]["success"], row[b]["success"]) for row in group if a in row and b in row]
        if both:
            summary[f"{b} - {a}"] = paired_difference(*np.transpose(np.array(both, float))[::-1])
    return summary


def tally(grasps: Sequence[Row]) -> Row:
    """Statistics of one method: success with a Wilson interval, under the shake too, and placeable; causes; what became
    of plans; pose in the hand; means of what it took."""
    causes = Counter(grasp["cause"] for grasp in grasps if not grasp["success"])
    in_hand = {
        name: [abs(grasp[name]) for grasp in grasps if name in grasp]
        for name in ("tilt_in_hand", "turn_in_hand", "shift_in_hand")
    }
    return {
        **trials(sum(grasp["success"] for grasp in grasps), len(grasps)),
        "shaken": trials(sum(grasp.get("shaken", False) for grasp in grasps), len(grasps)),
        "placeable": trials(sum(map(placeable, grasps)), len(grasps)),
        "causes": {cause: causes[cause] for cause in Cause if causes[cause]},
        "plans": dict(Counter(grasp["plan"] for grasp in grasps)),
        "arrived": sum(Outcome(grasp["plan"]).arrived for grasp in grasps),
        "error": summarize([grasp["error"] for grasp in grasps]),
        **{name: summarize(values) for name, values in in_hand.items() if values},
        **{
            name: float(np.mean([grasp[name] for grasp in grasps]))
            for name in ("seconds", "frames", "pictures", "views")
            if name in grasps[0]
        },
    }


def _contacts(group: Sequence[Row]) -> Row:
    """The extremes of each method's episodes: depth, mm, and speed, m/s."""
    contacts: Row = {}
    for method, grasps in by_method(group).items():
        deepest = np.array([grasp["deepest"] for grasp in grasps])
        contacts[method] = {
            "deepest": float(deepest.max()),
            "deepest_p99": float(np.percentile(deepest, 99)),
            "beyond_1.5mm": int((deepest > 1.5).sum()),
            "fastest": float(max(grasp["fastest"] for grasp in grasps)),
            "n": len(grasps),
        }
    return contacts


def columns(group: Sequence[Row]) -> Row:
    """Every episode of a case, column by column, so that thousands stay a small file.

    Success, and whether what was held is placeable, are texts of 0 and 1, with a dash for an episode without that
    method; causes and other columns go by the number of the start.
    """
    table: Row = {"tilt": [round(row["tilt"], 1) if "tilt" in row else None for row in group]}
    for method in by_method(group):
        grasps = [row.get(method) for row in group]
        while grasps[-1] is None:
            grasps.pop()
        told = {
            "success": ["-" if grasp is None else str(int(grasp["success"])) for grasp in grasps],
            "placeable": ["-" if grasp is None else str(int(placeable(grasp))) for grasp in grasps],
        }
        found: Row = {name: "".join(each) for name, each in told.items()}
        found["causes"] = {str(k): grasp["cause"] for k, grasp in enumerate(grasps) if grasp and "cause" in grasp}
        if method in ("thesis", "moments", "ours"):
            for name in ("error", "roll", "depth", "aside"):
                found[name] = [None if not grasp or name not in grasp else round(grasp[name], 1) for grasp in grasps]
        table[method] = found
    return table


def _status(rows: Sequence[Row]) -> str:
    held = {method: [row[method]["success"] for row in rows if method in row] for method in ("thesis", "ours")}
    return ", ".join(f"{method} {np.mean(successes):.0%}" for method, successes in held.items() if successes)


EXPERIMENT = Experiment(grasp_once, grasping_jobs, grasping_report, starts=200, status=_status)
"""Table 3.2."""
