"""How planners are measured: one episode loop, baselines, true errors and their statistics."""

from gvp_lib.evaluation.baselines import aligned_in_place, look_down, oracle, stay
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
from gvp_lib.evaluation.metrics import ViewpointError, face_corners, homography_error, homography_floor, viewpoint_error
from gvp_lib.evaluation.statistics import Interval, Summary, paired_difference, summarize, wilson_interval

__all__ = [
    "Interval",
    "Judgement",
    "Start",
    "Summary",
    "ViewpointError",
    "aligned_in_place",
    "begin",
    "begin_again",
    "canonical_views",
    "cell_of",
    "draw_start",
    "face_corners",
    "homography_error",
    "homography_floor",
    "judge",
    "look_down",
    "oracle",
    "paired_difference",
    "run_episode",
    "stay",
    "summarize",
    "viewpoint_error",
    "wilson_interval",
]
