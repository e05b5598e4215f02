"""Grasp viewpoint planning with one RGB camera in the hand (Smith, UC San Diego, 2020), in MuJoCo.

The public names are loaded when first used, so that ``import gvp_lib`` loads neither torch nor mujoco.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.1.0"

_HOME = {
    "GvpError": "errors",
    "CameraIntrinsics": "geometry.camera",
    "Calibration": "geometry.calibration",
    "calibrate": "geometry.calibration",
    "HandEye": "geometry.calibration",
    "calibrate_hand_eye": "geometry.calibration",
    "VirtualSphere": "geometry.sphere",
    "look_at": "geometry.sphere",
    "Segmenter": "perception.segmentation",
    "HsvThreshold": "perception.segmentation",
    "Blob": "perception.moments",
    "Tracker": "perception.tracking",
    "EyeInHandArm": "motion.arm",
    "Gripper": "motion.arm",
    "Hand": "motion.arm",
    "Motion": "motion.arm",
    "StopReason": "motion.arm",
    "Eye": "motion.sighting",
    "View": "motion.sighting",
    "center_on_object": "motion.centering",
    "align_with_major_axis": "motion.centering",
    "estimate_depth": "motion.primitives",
    "Arc": "motion.arc",
    "approach": "motion.arc",
    "traverse_arc": "motion.arc",
    "ViewpointEstimator": "planning.plan",
    "Optimum": "planning.plan",
    "QuarticFit": "planning.image_moments",
    "SilhouetteFit": "planning.silhouette",
    "ImageMomentPlanner": "planning.image_moments",
    "Plan": "planning.plan",
    "PlanOutcome": "planning.plan",
    "ClosingRule": "planning.grasp",
    "RangeThreshold": "planning.grasp",
    "SizedDepth": "planning.grasp",
    "Grasp": "planning.grasp",
    "GraspExecutor": "planning.grasp",
    "GraspOutcome": "planning.grasp",
    "Step": "planning.plan",
    "Action": "planning.plan",
    "Tilt": "planning.plan",
    "CnnPlanner": "planning.learned",
    "WorkCell": "simulation.workcell",
    "ArmSpec": "simulation.arms",
    "ARMS": "simulation.arms",
    "looking_down": "simulation.kinematics",
    "ObjectSpec": "simulation.objects",
    "OBJECTS": "simulation.objects",
    "CanonicalNormal": "simulation.objects",
    "Noise": "simulation.sensors",
    "FloatingCamera": "simulation.floating",
    "CollectionRecipe": "learning.recipe",
    "Variation": "learning.recipe",
    "collect_dataset": "learning.collect",
    "ViewpointDataset": "learning.dataset",
    "TrainConfig": "learning.config",
    "train": "learning.training",
    "NetworkPolicy": "learning.policy",
    "ViewpointEnv": "learning.environment",
    "Scene3D": "views.scene3d",
}

_EXTRA = {"views": "notebooks", "learning": "learning"}
"""What the light core does without: the extra, in pyproject.toml, that brings what a room needs."""

__all__ = [*_HOME, "__version__"]

if TYPE_CHECKING:
    from gvp_lib.errors import GvpError as GvpError
    from gvp_lib.geometry.calibration import Calibration as Calibration
    from gvp_lib.geometry.calibration import HandEye as HandEye
    from gvp_lib.geometry.calibration import calibrate as calibrate
    from gvp_lib.geometry.calibration import calibrate_hand_eye as calibrate_hand_eye
    from gvp_lib.geometry.camera import CameraIntrinsics as CameraIntrinsics
    from gvp_lib.geometry.sphere import VirtualSphere as VirtualSphere
    from gvp_lib.geometry.sphere import look_at as look_at
    from gvp_lib.learning.collect import collect_dataset as collect_dataset
    from gvp_lib.learning.config import TrainConfig as TrainConfig
    from gvp_lib.learning.dataset import ViewpointDataset as ViewpointDataset
    from gvp_lib.learning.environment import ViewpointEnv as ViewpointEnv
    from gvp_lib.learning.policy import NetworkPolicy as NetworkPolicy
    from gvp_lib.learning.recipe import CollectionRecipe as CollectionRecipe
    from gvp_lib.learning.recipe import Variation as Variation
    from gvp_lib.learning.training import train as train
    from gvp_lib.motion.arc import Arc as Arc
    from gvp_lib.motion.arc import approach as approach
    from gvp_lib.motion.arc import traverse_arc as traverse_arc
    from gvp_lib.motion.arm import EyeInHandArm as EyeInHandArm
    from gvp_lib.motion.arm import Gripper as Gripper
    from gvp_lib.motion.arm import Hand as Hand
    from gvp_lib.motion.arm import Motion as Motion
    from gvp_lib.motion.arm import StopReason as StopReason
    from gvp_lib.motion.centering import align_with_major_axis as align_with_major_axis
    from gvp_lib.motion.centering import center_on_object as center_on_object
    from gvp_lib.motion.primitives import estimate_depth as estimate_depth
    from gvp_lib.motion.sighting import Eye as Eye
    from gvp_lib.motion.sighting import View as View
    from gvp_lib.perception.moments import Blob as Blob
    from gvp_lib.perception.segmentation import HsvThreshold as HsvThreshold
    from gvp_lib.perception.segmentation import Segmenter as Segmenter
    from gvp_lib.perception.tracking import Tracker as Tracker
    from gvp_lib.planning.grasp import ClosingRule as ClosingRule
    from gvp_lib.planning.grasp import Grasp as Grasp
    from gvp_lib.planning.grasp import GraspExecutor as GraspExecutor
    from gvp_lib.planning.grasp import GraspOutcome as GraspOutcome
    from gvp_lib.planning.grasp import RangeThreshold as RangeThreshold
    from gvp_lib.planning.grasp import SizedDepth as SizedDepth
    from gvp_lib.planning.image_moments import ImageMomentPlanner as ImageMomentPlanner
    from gvp_lib.planning.image_moments import QuarticFit as QuarticFit
    from gvp_lib.planning.learned import CnnPlanner as CnnPlanner
    from gvp_lib.planning.plan import Action as Action
    from gvp_lib.planning.plan import Optimum as Optimum
    from gvp_lib.planning.plan import Plan as Plan
    from gvp_lib.planning.plan import PlanOutcome as PlanOutcome
    from gvp_lib.planning.plan import Step as Step
    from gvp_lib.planning.plan import Tilt as Tilt
    from gvp_lib.planning.plan import ViewpointEstimator as ViewpointEstimator
    from gvp_lib.planning.silhouette import SilhouetteFit as SilhouetteFit
    from gvp_lib.simulation.arms import ARMS as ARMS
    from gvp_lib.simulation.arms import ArmSpec as ArmSpec
    from gvp_lib.simulation.floating import FloatingCamera as FloatingCamera
    from gvp_lib.simulation.kinematics import looking_down as looking_down
    from gvp_lib.simulation.objects import OBJECTS as OBJECTS
    from gvp_lib.simulation.objects import CanonicalNormal as CanonicalNormal
    from gvp_lib.simulation.objects import ObjectSpec as ObjectSpec
    from gvp_lib.simulation.sensors import Noise as Noise
    from gvp_lib.simulation.workcell import WorkCell as WorkCell
    from gvp_lib.views.scene3d import Scene3D as Scene3D


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    room = _HOME[name].partition(".")[0]
    try:
        value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    except ModuleNotFoundError as error:
        if room not in _EXTRA or (error.name or "").startswith(__name__):
            raise
        from gvp_lib.errors import MissingExtraError

        raise MissingExtraError(name, error.name or "a package", _EXTRA[room]) from error
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
