"""How planners are measured: one episode loop, baselines, true errors and their statistics."""

from gvp_lib.evaluation.baselines import AlignInPlace, LookDown, Oracle, OracleGrasp, Stay
from gvp_lib.evaluation.comparison import Comparison, compare
from gvp_lib.evaluation.episodes import (
    Judgement,
    Start,
    begin,
    begin_again,
    canonical_views,
    cell_of,
    draw_start,
    judge,
    run_episode,
)
from gvp_lib.evaluation.graspable import GraspableView, GripJudge, JudgedGrip
from gvp_lib.evaluation.metrics import ViewpointError, face_corners, homography_error, homography_floor, viewpoint_error
from gvp_lib.evaluation.statistics import Interval, Summary, paired_difference, summarize, wilson_interval

__all__ = [
    "AlignInPlace",
    "Comparison",
    "GraspableView",
    "JudgedGrip",
    "GripJudge",
    "Interval",
    "Judgement",
    "LookDown",
    "Oracle",
    "OracleGrasp",
    "Start",
    "Stay",
    "Summary",
    "ViewpointError",
    "begin",
    "begin_again",
    "canonical_views",
    "cell_of",
    "compare",
    "draw_start",
    "face_corners",
    "homography_error",
    "homography_floor",
    "judge",
    "paired_difference",
    "run_episode",
    "summarize",
    "viewpoint_error",
    "wilson_interval",
]
