"""Planning of a grasp viewpoint: everything here sees an arm only through `gvp_lib.motion.arm.EyeInHandArm`."""

from gvp_lib.planning.grasp import ClosingRule, Grasp, GraspExecutor, GraspOutcome, RangeThreshold, Reading, SizedDepth
from gvp_lib.planning.image_moments import ImageMomentPlanner, Quartic, QuarticFit
from gvp_lib.planning.learned import CnnPlanner, fused
from gvp_lib.planning.plan import (
    Action,
    Finding,
    Optimum,
    Plan,
    PlanOutcome,
    Policy,
    Step,
    Tilt,
    ViewpointEstimator,
    axes_after,
)
from gvp_lib.planning.silhouette import SilhouetteFit
from gvp_lib.planning.solids import BOX, CYLINDER, FittedSolid, Shape

__all__ = [
    "BOX",
    "CYLINDER",
    "Action",
    "ClosingRule",
    "CnnPlanner",
    "Finding",
    "FittedSolid",
    "Grasp",
    "GraspExecutor",
    "GraspOutcome",
    "ImageMomentPlanner",
    "Optimum",
    "Plan",
    "PlanOutcome",
    "Policy",
    "Quartic",
    "QuarticFit",
    "RangeThreshold",
    "Reading",
    "Shape",
    "SilhouetteFit",
    "SizedDepth",
    "Step",
    "Tilt",
    "ViewpointEstimator",
    "axes_after",
    "fused",
]
