"""Planning of a grasp viewpoint: everything here sees an arm only through `gvp_lib.motion.arm.EyeInHandArm`."""

from gvp_lib.planning.closing import ClosingRule, RangeThreshold, Reading, SizedDepth
from gvp_lib.planning.contours import ContourFit
from gvp_lib.planning.grasp import Grasp, GraspExecutor
from gvp_lib.planning.grips import Grip
from gvp_lib.planning.hull import VisualHull
from gvp_lib.planning.image_moments import ImageMomentPlanner, QuarticFit
from gvp_lib.planning.learned import CnnPlanner, fused
from gvp_lib.planning.picking import Executor, LookDown, PickUp, RobustPlanner, pick_up
from gvp_lib.planning.plan import (
    Action,
    Optimum,
    Plan,
    Policy,
    Quartic,
    Step,
    Tilt,
    ViewpointEstimator,
    ViewpointPlanner,
    axes_after,
)
from gvp_lib.planning.silhouette import SilhouetteFit
from gvp_lib.planning.solids import BOX, CYLINDER, FittedSolid, Shape
from gvp_lib.planning.spread import SpreadViews

__all__ = [
    "BOX",
    "CYLINDER",
    "Action",
    "ClosingRule",
    "CnnPlanner",
    "ContourFit",
    "Executor",
    "FittedSolid",
    "Grasp",
    "GraspExecutor",
    "Grip",
    "ImageMomentPlanner",
    "LookDown",
    "Optimum",
    "PickUp",
    "Plan",
    "Policy",
    "Quartic",
    "QuarticFit",
    "RangeThreshold",
    "Reading",
    "RobustPlanner",
    "Shape",
    "SilhouetteFit",
    "SizedDepth",
    "SpreadViews",
    "Step",
    "Tilt",
    "ViewpointEstimator",
    "ViewpointPlanner",
    "VisualHull",
    "axes_after",
    "fused",
    "pick_up",
]
