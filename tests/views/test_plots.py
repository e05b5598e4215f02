"""Objects show themselves as pictures also where they hold next to nothing; ordinary ones: `test_public_objects.py`."""

import re
import subprocess
import sys
from dataclasses import dataclass, replace
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from eye_in_hand import CAMERA, PinholeArm, Plate, white
from hands import PlainGripper
from matplotlib.text import Text
from numpy.typing import NDArray
from public_names import check_picture
from scipy.spatial.transform import RigidTransform, Rotation
from synthetic import arc_of_ratios, over_block

from gvp_lib.geometry.calibration import Calibration
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.motion.arm import Outcome
from gvp_lib.perception.blobs import Blob
from gvp_lib.planning.grasp import GraspExecutor
from gvp_lib.planning.image_moments import ImageMomentPlanner, QuarticFit
from gvp_lib.planning.learned import CnnPlanner
from gvp_lib.planning.picking import PickUp
from gvp_lib.planning.plan import Action, Optimum
from gvp_lib.planning.silhouette import SilhouetteFit
from gvp_lib.planning.solids import FittedSolid
from gvp_lib.simulation.workcell import WorkCell
from gvp_lib.views import figures

ARC = arc_of_ratios(0.5 + 0.01 * (np.arange(11) - 4) ** 2)
EMPTY_ARC = replace(ARC, views=(), center=-1, ranges=np.empty(0))
EPOCH = {"loss": 1.0, "validation_loss": 1.2, "accuracy": 0.5, "validation_accuracy": 0.4}


class Training(SimpleNamespace):
    """What a figure needs of a training."""


@dataclass
class ViewpointDataset:
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


EXAMPLES = {
    "blob, one pixel": lambda plan_of: Blob.from_mask(np.ones((1, 1), bool)).plot(image=np.zeros((9, 9, 3), np.uint8)),
    "arc, empty": lambda plan_of: EMPTY_ARC.plot(),
    "quartic of angles, without samples": lambda plan_of: QuarticFit("angle").fit(ARC).plot(),
    "solid that explains nothing": lambda plan_of: replace(solid(plan_of), residual=1.0, kind="cylinder").plot(),
    "optimum, only joint angles": lambda plan_of: Optimum.at(ARC, 2).plot(),
    "optimum of a solid": lambda plan_of: plan_of(SilhouetteFit()).optima[-1].plot(),
    "optimum of a quartic": lambda plan_of: plan_of(QuarticFit()).optima[-1].plot(),
    "plan of actions": lambda plan_of: loop(Action.LEFT).plot(),
    "plan, with arcs of another": lambda plan_of: replace(
        plan_of(QuarticFit()), arcs=(EMPTY_ARC, ARC, *plan_of(QuarticFit()).arcs), view=None
    ).plot(),
    "plan, only a view": lambda plan_of: replace(plan_of(QuarticFit()), arcs=(), optima=()).plot(),
    "grasp, empty": lambda plan_of: grasp(dark).plot(),
    "pick-up, empty": lambda plan_of: PickUp(unseen(), grasp(dark), 0.1).plot(),
    "data set, empty": lambda plan_of: figures.plot_dataset(ViewpointDataset(np.zeros((0, 64, 64, 3), np.uint8))),
    "training, empty": lambda plan_of: figures.plot_training(Training(history=[])),
    "calibration, no distortion": lambda plan_of: Calibration(CAMERA, np.zeros(5), 0.0, [0.0, 0.0], ()).plot(),
    "sphere, one viewpoint": lambda plan_of: VirtualSphere((0, 0, 0), 0.5).plot(
        viewpoints=VirtualSphere((0, 0, 0), 0.5).viewpoint(0.1, 0.0)
    ),
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_object_shows_itself_as_a_picture_that_fits_a_page_and_is_not_blank(name, plan_of) -> None:
    check_picture(EXAMPLES[name](plan_of)._repr_png_())


def tilted(kind: str, sizes, top: float, seed: int) -> FittedSolid:
    pose = RigidTransform.from_rotation(Rotation.random(rng=seed))
    normal = pose.rotation.as_matrix()[:, 2]
    normal *= np.sign(normal[2])
    return FittedSolid(kind, pose, np.array(sizes), (top, top), normal, 0.01, 0.1, np.zeros((0, 6)))


WORDS = {
    "arc, begun at its start": replace(ARC, center=0),
    "arc, begun near its end": replace(ARC, center=8, ends=(Outcome.MAX_ANGLE, Outcome.TARGET_NOT_FOUND)),
    "box with a top, seen along its length": tilted("box", (0.112, 0.033, 0.029), 0.002, 3),
    "box with a top": tilted("box", (0.112, 0.033, 0.029), 0.002, 10),
    "cylinder, its normal toward the reader": tilted("cylinder", (0.06, 0.06, 0.15), 0.0, 11),
}


@pytest.mark.parametrize("name", WORDS)
def test_no_word_in_a_figure_lies_over_another(name) -> None:
    figure = WORDS[name].plot()
    figure.draw_without_rendering()
    words = [Text.get_window_extent(word) for ax in figure.axes for word in ax.texts]
    assert len(words) > 1
    assert not any(one.overlaps(other) for one, other in combinations(words, 2))


def test_a_boxs_length_stands_at_an_edge_that_is_as_long_whatever_its_top() -> None:
    with_top, plain = (tilted("box", (0.112, 0.033, 0.029), top, 36).plot().axes[0].texts for top in (0.002, 0.0))
    for word, same in zip(with_top[1:3], plain[1:3], strict=True):
        assert word.get_text() == same.get_text()
        np.testing.assert_allclose(word.xy, same.xy, atol=2.5)  # mm


def test_a_look_at_a_cell_changes_nothing_that_is_random() -> None:
    from gvp_lib.simulation.sensors import Noise

    with WorkCell("floating", noise=Noise.thesis(), seed=1) as cell:
        first = cell.arm.capture()
        cell.reset()
        cell.plot()
        np.testing.assert_array_equal(cell.arm.capture(), first)


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
