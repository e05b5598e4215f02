"""One episode loop for every planner and every baseline: a start, a plan, a judgement."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from dataclasses import asdict, astuple, dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from gvp_lib.checks import checked
from gvp_lib.errors import GvpError, InvalidParameterError, UnreachableError
from gvp_lib.evaluation.metrics import viewpoint_error
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.motion.primitives import toward_pixel
from gvp_lib.picture import count
from gvp_lib.planning.plan import Plan, ViewpointPlanner
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import CellCache, WorkCell

__all__ = [
    "Judgement",
    "Start",
    "begin",
    "begin_again",
    "canonical_views",
    "cell_of",
    "draw_start",
    "judge",
    "run_episode",
]

RADIUS = 0.25  # m, of the virtual sphere on which an aligned camera stands
DISTANCES = (0.25, 0.35)  # m, from which an episode begins
OFF_CENTER = 100.0  # px, at most
_TRIES = 200


@dataclass(frozen=True, eq=False)
class Start:
    """Start of an episode.

    Attributes
    ----------
    world_from_camera
        Pose of the camera.
    tilt, azimuth, roll
        Viewpoint relative to the accepted normal, rad.
    distance
        Distance to the object's center, m.
    pixel
        Where the object's center appears, (u, v), px.
    tries
        Draws until one could be reached, this one included.
    """

    world_from_camera: RigidTransform
    tilt: float
    azimuth: float
    roll: float
    distance: float
    pixel: tuple[float, float]
    tries: int

    def __repr__(self) -> str:
        tries = count(self.tries, "try")
        return f"Start({np.degrees(self.tilt):.0f} deg off the normal, {self.distance:.2f} m away, {tries})"


@dataclass(frozen=True)
class Judgement:
    """Judgement of an episode, by the truth.

    Attributes
    ----------
    outcome
        Plan's outcome, as text.
    total, about_x, about_y, roll
        True error at the end, deg; see :class:`ViewpointError`.
    frames, views
        Pictures taken, and views in the trace.
    seconds
        Simulated time, s.
    """

    outcome: str
    total: float
    about_x: float
    about_y: float
    roll: float
    frames: int
    views: int
    seconds: float

    def __repr__(self) -> str:
        pictures = count(self.frames, "picture")
        return f"Judgement({self.outcome}, {self.total:.2f} deg off, roll {self.roll:.1f} deg, {pictures})"

    def to_dict(self) -> dict[str, Any]:
        """As JSON data."""
        return asdict(self)


_kept: CellCache[WorkCell] = CellCache()


@checked
def cell_of(job: Mapping[str, Any]) -> WorkCell:
    """Build the work cell of an episode, or reuse the last one where it is the same.

    Parameters
    ----------
    job
        JSON data: ``target``; ``placement``; ``noise``, fields of :class:`gvp_lib.Noise`; optionally ``arm`` (default:
        Baxter) and ``cell``, further arguments of :class:`gvp_lib.WorkCell`.

    Examples
    --------
    >>> from gvp_lib.evaluation import cell_of
    >>> job = {"arm": "floating", "target": "cuboid_1x2", "placement": "flat", "noise": {"pixel_sd": 2.0}}
    >>> cell_of(job) is cell_of(job)
    True
    """
    if missing := [name for name in ("target", "placement", "noise") if name not in job]:
        raise InvalidParameterError(f"a job has target, placement and noise; {', '.join(missing)} missing in {job!r}")
    case, options = (job.get("arm", "baxter"), job["target"], job["placement"]), job.get("cell", {})
    key = *case, json.dumps([job["noise"], options], sort_keys=True)
    return _kept.get(key, lambda: WorkCell(*case, noise=Noise(**job["noise"]), **options))


@checked
def begin(cell: WorkCell, k: int, seed: int = 2020) -> Start:
    """Place the object anew and the camera at a start; the same for every planner and every noise.

    Parameters
    ----------
    cell
        Cell, whose target and placement the starts belong to.
    k
        Number of the start, from 0.
    seed
        Seed of all starts; 2020 gives those of Tables 3.1 and 3.2.

    Raises
    ------
    GvpError
        The arm could not look at the object from above in any of 20 places drawn.

    Examples
    --------
    >>> from gvp_lib.evaluation import begin
    >>> begin(WorkCell(arm="floating", target="cuboid_1x2"), 0)
    Start(31 deg off the normal, 0.31 m away, 1 try)
    """
    target, placement = cell.target_spec.name, cell.placement
    case = zlib.crc32(f"{target} {placement}".encode())
    cell.target_spec.centered()
    for attempt in range(20):
        places, draws = np.random.SeedSequence([seed, case, k, attempt]).spawn(2)
        cell.reset(places)
        try:
            return draw_start(cell, np.random.default_rng(draws))
        except GvpError:
            continue  # the object stands where the arm cannot look at it from above
    raise GvpError(f"no place within reach for {target!r} {placement!r}, start {k}")


@checked
def draw_start(
    cell: WorkCell,
    rng: np.random.Generator,
    tilt: tuple[float, float] = (10.0, 40.0),
    *,
    distances: tuple[float, float] = DISTANCES,
    radius: float = RADIUS,
    by_area: bool = False,
) -> Start:
    """Draw where an episode begins, and place the camera there.

    The tilt lies between two angles from the accepted normal, azimuth and roll are uniform, and the object is up to
    100 px off the image's center. As the thesis's operator did (3.1.1), the draw is repeated until the arm can reach
    it, can turn to the object from there, and can reach a canonical view of it.

    Parameters
    ----------
    cell
        Cell in which the object stands already.
    rng
        Generator of the draws.
    tilt
        Least and largest tilt, deg.
    distances
        Least and largest distance from the object's center, m; uniform between them.
    radius
        Radius of the sphere on which an aligned view must be within reach, m.
    by_area
        Whether the tilt is drawn so that equal areas of the sphere are equally likely, rather than equal angles.

    Raises
    ------
    GvpError
        No start was found in 200 draws.
    ModelError
        The object's origin, at which a start looks, is not the middle of its bounding box.

    Examples
    --------
    >>> cell = WorkCell(arm="floating", target="cuboid_1x2")
    >>> draw_start(cell, np.random.default_rng(1), tilt=(20.0, 20.0))
    Start(20 deg off the normal, 0.34 m away, 1 try)
    """
    if not (0 <= tilt[0] <= tilt[1] <= 180 and 0 < distances[0] <= distances[1] < np.inf):
        raise InvalidParameterError(
            "tilts go from the least to the largest, within 0 to 180 deg, and so do distances, positive, in m; got "
            f"{tilt} and {distances}"
        )
    truth, lens = cell.truth, cell.arm.intrinsics
    cell.target_spec.centered()
    center, normal = truth.world_from_object.translation, truth.normal.direction
    if not any(_reachable(cell, view) for view in canonical_views(cell, radius)):
        raise GvpError("the arm cannot reach a canonical view of the object where it stands; draw another place")
    for tries in range(1, _TRIES + 1):
        angle = np.arccos(rng.uniform(*np.cos(np.radians(tilt[::-1])))) if by_area else np.radians(rng.uniform(*tilt))
        azimuth, roll = rng.uniform(0, 2 * np.pi, 2)
        distance = rng.uniform(*distances)
        off, direction = OFF_CENTER * np.sqrt(rng.uniform()), rng.uniform(0, 2 * np.pi)
        pixel = lens.principal_point + off * np.array([np.cos(direction), np.sin(direction)])
        turn = RigidTransform.from_rotation(toward_pixel(lens, pixel).inv())
        pose = VirtualSphere(center, distance, normal).viewpoint(angle, azimuth, roll) * turn
        if _reachable(cell, pose) and cell.arm.move_camera(turn.inv()):
            cell.place_camera(pose)
            u, v = pixel.tolist()
            return Start(pose, float(angle), float(azimuth), float(roll), float(distance), (u, v), tries)
    raise GvpError(f"no start within reach of the arm in {_TRIES} draws; try another placement or smaller tilts")


@checked
def begin_again(cell: WorkCell, start: Start) -> None:
    """Set the same episode up once more, for another planner.

    Parameters
    ----------
    cell
        Cell in which the start was drawn.
    start
        Where the episode begins.

    Examples
    --------
    >>> from gvp_lib.evaluation import AlignInPlace, Stay, begin, begin_again, run_episode
    >>> cell = WorkCell(arm="floating", target="cuboid_1x2")
    >>> start = begin(cell, 0)
    >>> for planner in (Stay(cell.segmenter), AlignInPlace(cell.segmenter)):
    ...     begin_again(cell, start)
    ...     _, judged = run_episode(cell, planner)
    ...     print(planner, round(judged.total), "deg off")
    Stay() 30 deg off
    AlignInPlace(radius=0.25) 29 deg off
    """
    cell.reset()
    cell.place_camera(start.world_from_camera)


@checked
def canonical_views(cell: WorkCell, radius: float = RADIUS) -> list[RigidTransform]:
    """Aligned views, ``world_from_camera``, nearest first: x on the minor axis, y on the major one. The judge's.

    Parameters
    ----------
    cell
        Cell as it stands. Where any roll will do, eight views stand for all.
    radius
        Distance of the views from the object's center, m.

    Examples
    --------
    >>> from gvp_lib.evaluation import canonical_views
    >>> [len(canonical_views(WorkCell(arm="floating", target=name))) for name in ("cuboid_1x1", "cuboid_1x2")]
    [4, 2]
    """
    truth = cell.truth
    here = truth.world_from_camera
    normal = truth.normal.nearest(-here.rotation.as_matrix()[:, 2])
    y = truth.normal.major_axis if truth.normal.major_axis is not None else here.rotation.as_matrix()[:, 1]
    sphere = VirtualSphere(truth.world_from_object.translation, radius, normal)
    level = sphere.viewpoint(0.0, 0.0)
    along_x, along_y, _ = level.rotation.as_matrix().T @ np.array(y)
    symmetry = truth.normal.symmetry or np.pi / 4
    rolls = np.arctan2(-along_x, along_y) + symmetry * np.arange(round(2 * np.pi / symmetry))
    views = [sphere.viewpoint(0.0, 0.0, roll) for roll in rolls]
    return sorted(views, key=lambda view: float((here.rotation.inv() * view.rotation).magnitude()))


@checked
def run_episode(cell: WorkCell, planner: ViewpointPlanner) -> tuple[Plan, Judgement]:
    """Let a planner act on a cell's arm as it stands, and judge where it leaves the camera.

    Parameters
    ----------
    cell
        Cell at a start. The planner is given ``cell.arm`` alone.
    planner
        Anything with a method ``plan(arm)``.

    Examples
    --------
    >>> from gvp_lib.evaluation import begin, run_episode
    >>> from gvp_lib.planning import LookDown
    >>> cell = WorkCell(arm="floating", target="cuboid_1x2")
    >>> start = begin(cell, 0)
    >>> plan, judged = run_episode(cell, LookDown(cell.segmenter))
    >>> plan.frames == judged.frames, judged.total < 2
    (True, True)
    """
    began = cell.time
    plan = planner.plan(cell.arm)
    if not isinstance(plan, Plan):
        raise InvalidParameterError(f"{type(planner).__name__}.plan returned {plan!r}; a planner returns a Plan")
    return plan, judge(cell, plan, cell.time - began)


@checked
def judge(cell: WorkCell, plan: Plan, seconds: float) -> Judgement:
    """Judge a plan by the truth.

    Parameters
    ----------
    cell
        Cell whose camera stands where the plan left it.
    plan
        The plan.
    seconds
        Simulated time it took, s.

    Examples
    --------
    >>> from gvp_lib.evaluation import Stay, judge
    >>> cell = WorkCell(arm="floating", target="cuboid_1x2", seed=1)
    >>> judge(cell, Stay(cell.segmenter).plan(cell.arm), seconds=cell.time)
    Judgement(aligned, 4.5... deg off, roll ... deg, 3 pictures)
    """
    total, about_x, about_y, roll = np.degrees(astuple(viewpoint_error(cell.truth))).tolist()
    return Judgement(plan.outcome.value, total, about_x, about_y, roll, plan.frames, len(plan.views), float(seconds))


def _reachable(cell: WorkCell, world_from_camera: RigidTransform) -> bool:
    try:
        cell.place_camera(world_from_camera)
    except UnreachableError:
        return False
    return True
