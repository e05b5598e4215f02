"""Objects show themselves as pictures, also where they hold next to nothing."""

import re
import subprocess
import sys
from dataclasses import dataclass, replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from eye_in_hand import CAMERA, PinholeArm, Plate, white
from hands import PlainGripper
from numpy.typing import NDArray
from synthetic import arc_of_ratios, over_block

from gvp_lib.evaluation.comparison import Comparison
from gvp_lib.evaluation.episodes import Judgement
from gvp_lib.geometry.calibration import Calibration
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.perception.moments import Blob
from gvp_lib.planning.grasp import GraspExecutor
from gvp_lib.planning.image_moments import ImageMomentPlanner, QuarticFit
from gvp_lib.planning.learned import CnnPlanner
from gvp_lib.planning.picking import PickUp
from gvp_lib.planning.plan import Action, Tilt
from gvp_lib.planning.silhouette import SilhouetteFit
from gvp_lib.simulation.arms import ARMS
from gvp_lib.simulation.objects import OBJECTS
from gvp_lib.simulation.workcell import WorkCell
from gvp_lib.views import figures

ARC = arc_of_ratios(0.5 + 0.01 * (np.arange(11) - 4) ** 2)
EMPTY_ARC = replace(ARC, views=(), center=-1, ranges=np.empty(0))
EPOCH = {"loss": 1.0, "validation_loss": 1.2, "accuracy": 0.5, "validation_accuracy": 0.4}


@dataclass
class Pictures:
    """What a figure needs of a data set."""

    images: NDArray[np.uint8]
    size, split = 64, "train"

    def __post_init__(self) -> None:
        self.tilts, self.actions = np.full((len(self), 2), 0.2), np.arange(len(self)) % 5

    def __len__(self) -> int:
        return len(self.images)


def dark(rgb):
    return np.zeros(rgb.shape[:2], bool)


def unseen():
    return ImageMomentPlanner(dark).plan(over_block())


def grasp(segmenter=white):
    arm = PinholeArm(Plate(), radius=0.3)
    return GraspExecutor(segmenter).grasp(arm, PlainGripper(arm))


def loop(answer):
    return CnnPlanner(white, lambda rgb: answer, radius=0.3, max_steps=3, survey=0).plan(over_block())


def solid(plan_of):
    return plan_of(SilhouetteFit()).solid


def judged(error):
    return Judgement("aligned", error, error, 0.0, 0.0, frames=9, views=3, seconds=1.0)


EXAMPLES = {
    "blob": lambda plan_of: ARC.views[0].blob.plot(),
    "blob, one pixel": lambda plan_of: Blob.from_mask(np.ones((1, 1), bool)).plot(image=np.zeros((9, 9, 3), np.uint8)),
    "view": lambda plan_of: replace(ARC.views[0], rgb=np.zeros((480, 640, 3), np.uint8), clipped=True).plot(),
    "arc": lambda plan_of: ARC.plot(),
    "arc, empty": lambda plan_of: EMPTY_ARC.plot(),
    "quartic": lambda plan_of: QuarticFit().fit(ARC).plot(ratios=ARC.ratios),
    "quartic of angles, without samples": lambda plan_of: QuarticFit("angle").fit(ARC).plot(),
    "solid": lambda plan_of: solid(plan_of).plot(),
    "solid that explains nothing": lambda plan_of: replace(solid(plan_of), residual=1.0, kind="cylinder").plot(),
    "plan": lambda plan_of: plan_of(QuarticFit()).plot(),
    "plan with a solid": lambda plan_of: plan_of(SilhouetteFit()).plot(),
    "plan of actions": lambda plan_of: loop(Action.LEFT).plot(),
    "plan of tilts": lambda plan_of: loop(Tilt(0.0, 0.3, sigma=0.1)).plot(),
    "plan, with arcs of another": lambda plan_of: replace(
        plan_of(QuarticFit()), arcs=(EMPTY_ARC, ARC, *plan_of(QuarticFit()).arcs), view=None
    ).plot(),
    "plan, only a view": lambda plan_of: replace(plan_of(QuarticFit()), arcs=(), optima=()).plot(),
    "plan, empty": lambda plan_of: unseen().plot(),
    "grasp": lambda plan_of: grasp().plot(),
    "grasp, empty": lambda plan_of: grasp(dark).plot(),
    "pick-up": lambda plan_of: PickUp(plan_of(SilhouetteFit()), grasp(), 40.0).plot(),
    "pick-up, empty": lambda plan_of: PickUp(unseen(), grasp(dark), 0.1).plot(),
    "cell": lambda plan_of: WorkCell("floating").plot(),
    "object": lambda plan_of: OBJECTS["cylinder"].plot(),
    "arm": lambda plan_of: ARMS["ur5e"].plot(),
    "data set": lambda plan_of: figures.plot_dataset(Pictures(np.zeros((20, 64, 64, 3), np.uint8))),
    "data set, empty": lambda plan_of: figures.plot_dataset(Pictures(np.zeros((0, 64, 64, 3), np.uint8))),
    "training": lambda plan_of: figures.plot_training(SimpleNamespace(history=[EPOCH, EPOCH])),
    "training, empty": lambda plan_of: figures.plot_training(SimpleNamespace(history=[])),
    "comparison": lambda plan_of: Comparison({"ours": (judged(1.0), judged(2.0)), "stay": (judged(30.0),) * 2}).plot(),
    "calibration": lambda plan_of: Calibration(CAMERA, [0.1, 0, 0, 0, 0], 0.1, [1.0, 1.0], (0, 1)).plot(),
    "calibration, no distortion": lambda plan_of: Calibration(CAMERA, np.zeros(5), 0.0, [0.0, 0.0], ()).plot(),
    "sphere": lambda plan_of: VirtualSphere((0, 0, 0), 0.5).plot(),
    "sphere, one viewpoint": lambda plan_of: VirtualSphere((0, 0, 0), 0.5).plot(
        viewpoints=VirtualSphere((0, 0, 0), 0.5).viewpoint(0.1, 0.0)
    ),
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_object_shows_itself_as_a_picture_that_fits_a_page_and_is_not_blank(name, plan_of) -> None:
    png = EXAMPLES[name](plan_of)._repr_png_()
    pixels = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_GRAYSCALE)
    height, width = pixels.shape
    assert 300 <= width <= 1000
    assert 150 <= height <= 1000
    assert len(png) < 300_000
    assert np.ptp(pixels) > 100
    border = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
    assert (border > 200).all(), "nothing is cut off at the figure's border"


def test_a_look_at_a_cell_changes_nothing_that_is_random() -> None:
    from gvp_lib.simulation.sensors import Noise

    with WorkCell("floating", noise=Noise.thesis(), seed=1) as cell:
        first = cell.arm.capture()
        cell.reset()
        cell.plot()
        np.testing.assert_array_equal(cell.arm.capture(), first)


def test_a_plan_that_no_solid_explains_says_so_in_red(plan_of) -> None:
    plan = plan_of(SilhouetteFit())
    title = replace(plan, outcome=type(plan.outcome).UNEXPLAINED).plot()._suptitle
    assert re.search(r"unexplained.*\n.*far off", title.get_text())
    assert title.get_color() == figures.COLORS["vermilion"] != plan.plot()._suptitle.get_color()


def test_without_matplotlib_a_notebook_shows_the_repr_and_plot_names_the_extra() -> None:
    program = (
        "import sys; sys.modules['matplotlib'] = None\n"
        "from gvp_lib import VirtualSphere\n"
        "sphere = VirtualSphere((0, 0, 0), 1.0)\n"
        "print(sphere._repr_png_())\n"
        "try: sphere.plot()\n"
        "except ImportError as error: print(type(error).__name__, error)"
    )
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert re.match(r"None\nMissingExtraError .*gvp_lib\[notebooks\]", said)


def test_no_plot_needs_pyplot() -> None:
    program = "import sys; from gvp_lib import Blob, VirtualSphere; VirtualSphere((0, 0, 0), 1.0)._repr_png_()\n"
    program += "sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
