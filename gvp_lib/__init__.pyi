"""The names at the top, one a line: for type checkers, editors, and ``gvp_lib.lazy``.

A name that needs what only an extra installs says so; without it, ``from gvp_lib import *`` leaves the name out.
"""

from gvp_lib.errors import GvpError as GvpError
from gvp_lib.geometry import CameraIntrinsics as CameraIntrinsics
from gvp_lib.geometry import VirtualSphere as VirtualSphere
from gvp_lib.learning import NetworkPolicy as NetworkPolicy  # needs torch
from gvp_lib.learning import TrainConfig as TrainConfig  # needs torch
from gvp_lib.learning import ViewpointDataset as ViewpointDataset  # needs torch
from gvp_lib.learning import ViewpointEnv as ViewpointEnv  # needs gymnasium
from gvp_lib.learning import collect_dataset as collect_dataset  # needs pyarrow
from gvp_lib.learning import train as train  # needs torch
from gvp_lib.motion import Eye as Eye
from gvp_lib.motion import EyeInHandArm as EyeInHandArm
from gvp_lib.motion import Gripper as Gripper
from gvp_lib.perception import Blob as Blob
from gvp_lib.perception import HsvThreshold as HsvThreshold
from gvp_lib.perception import Saliency as Saliency
from gvp_lib.planning import CnnPlanner as CnnPlanner
from gvp_lib.planning import ContourFit as ContourFit
from gvp_lib.planning import GraspExecutor as GraspExecutor
from gvp_lib.planning import ImageMomentPlanner as ImageMomentPlanner
from gvp_lib.planning import Plan as Plan
from gvp_lib.planning import QuarticFit as QuarticFit
from gvp_lib.planning import RobustPlanner as RobustPlanner
from gvp_lib.planning import SilhouetteFit as SilhouetteFit
from gvp_lib.planning import SpreadViews as SpreadViews
from gvp_lib.planning import pick_up as pick_up
from gvp_lib.simulation import ARMS as ARMS
from gvp_lib.simulation import OBJECTS as OBJECTS
from gvp_lib.simulation import ArmSpec as ArmSpec
from gvp_lib.simulation import Noise as Noise
from gvp_lib.simulation import ObjectSpec as ObjectSpec
from gvp_lib.simulation import WorkCell as WorkCell
from gvp_lib.views import Scene3D as Scene3D  # needs tornado

__version__: str
