"""How public objects show themselves: in one short line, and those with something to see as a picture."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property
from itertools import chain, pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from cells import Cells
from eye_in_hand import PinholeArm, Plate, white
from hands import PlainGripper
from public_names import ROOMS, check_picture, exported, is_kind_of_type, names_of
from scipy.spatial.transform import RigidTransform
from synthetic import over_block
from tiny_training import lesson
from viewpoint_sets import collect, small

import gvp_lib

LONGEST = 160
SHOWS_NOTHING = {"Pictured"}  # classes to inherit from
BARRED = re.compile(r"\n|\b0x[0-9a-f]|\barray\(|\btensor\(|<function")
LONG = "left_wrist_camera_of_the_second_dual_arm_robot_in_the_north_bay"
THIRD = 1 / 3  # all of its digits fill a line soon

CLASSES = {
    name: value
    for room in ROOMS
    for name, value in exported(room).items()
    if inspect.isclass(value) and not is_kind_of_type(value) and name not in SHOWS_NOTHING
}
public = SimpleNamespace(**{name: value for room in ROOMS for name, value in names_of(room).items()})


class OwnSegmenter:
    """A user's segmenter, without a repr of its own."""

    def __call__(self, rgb: Any) -> Any:
        return white(rgb)


SIDES = (0.1, 0.0), (0.5, 1.0), (0.6, 3.0), (0.7, 5.0)  # rad


def reddish(rgb: Any) -> Any:
    return rgb[..., 0] > rgb[..., 1] + 60.0


class World:
    """What examples are made from, each made once."""

    @cached_property
    def grip_judge(self) -> Any:
        return public.GripJudge(self.cells("baxter", "cuboid_1x2", "flat"))

    def __init__(self, folder: Path) -> None:
        self.folder, self.cells = folder, Cells()

    @cached_property
    def cell(self) -> Any:
        return self.cells("baxter", "cuboid_1x2", "tilted", noise=public.Noise.thesis())

    @cached_property
    def floating(self) -> Any:
        return self.cells("floating", "tomato_soup_box", "side")

    @cached_property
    def picture(self) -> Any:
        return self.cell.arm.capture()

    @cached_property
    def desk(self) -> list[Any]:
        """A sheet with a red card on it, from four sides."""
        page = np.stack([public.Sheet().image(100)] * 3, axis=-1)
        page[500:700, 300:500] = 190, 30, 30
        lens = public.CameraIntrinsics(960, 720, 820, 820, 479.5, 359.5)
        paper = np.array([[0.000254, 0, -0.105], [0, -0.000254, 0.1485], [0, 0, 0], [0, 0, 1]])
        sides = [public.VirtualSphere((0, 0, 0), 0.45).viewpoint(tilt, turn) for tilt, turn in SIDES]
        return [
            cv2.warpPerspective(
                page, lens.matrix @ side.inv().as_matrix()[:3] @ paper, (960, 720), borderValue=(90,) * 3
            )
            for side in sides
        ]

    @cached_property
    def photographs(self) -> Any:
        return public.views_from_photographs(self.desk, public.Sheet(), reddish)

    @cached_property
    def optimum(self) -> Any:
        return public.ContourFit().estimate([self.photographs.arc], self.photographs.intrinsics)

    @cached_property
    def arm(self) -> PinholeArm:
        return over_block()

    @cached_property
    def eye(self) -> Any:
        eye = public.Eye(over_block(), white)
        eye.look()
        return eye

    @cached_property
    def plans(self) -> list[Any]:
        """By an estimator with solids, by one with quartics, of an arm that sees nothing, and learned."""
        estimators = public.SilhouetteFit(), public.QuarticFit()
        tilt = public.Tilt(0.0, THIRD, sigma=0.1)
        return [
            *(public.ImageMomentPlanner(white, estimator).plan(over_block()) for estimator in estimators),
            public.ImageMomentPlanner(lambda rgb: white(rgb) & False).plan(over_block()),
            public.CnnPlanner(white, policy=lambda rgb: tilt, radius=0.3, max_steps=3, survey=0).plan(over_block()),
        ]

    def of_plans(self, cls: type) -> list[Any]:
        """Every instance of a class that a plan, or an optimum of one, has in a field."""
        owners = [*self.plans, *(optimum for plan in self.plans for optimum in plan.optima)]
        values = [getattr(owner, field.name) for owner in owners for field in dataclasses.fields(owner)]
        values += [each for value in values if isinstance(value, tuple) for each in value]
        return [value for value in values if isinstance(value, cls)]

    @cached_property
    def grasp(self) -> Any:
        arm = PinholeArm(Plate(), radius=0.3)
        return public.GraspExecutor(white).grasp(arm, PlainGripper(arm))

    @cached_property
    def own_arm(self) -> Any:
        return replace(public.ARMS["baxter"], name=LONG)

    @cached_property
    def own_object(self) -> Any:
        brick = public.OBJECTS["cuboid_1x2"]
        return replace(brick, name=LONG, title=LONG.replace("_", " "), segmenter=OwnSegmenter())

    @cached_property
    def collection(self) -> Any:
        return collect(self.folder / "viewpoints", small())

    @cached_property
    def training(self) -> Any:
        return lesson(self.collection.folder, self.folder / "trained", network="resnet18_half", epochs=1)

    @cached_property
    def scene(self) -> Any:
        return public.Scene3D(self.floating, title=LONG)


EXAMPLES: dict[str, Callable[[World], list[Any]]] = {
    # geometry
    "Calibration": lambda w: [
        public.Calibration(w.arm.intrinsics, np.full(5, THIRD), 0.2, np.ones(2), tuple(range(60)), THIRD),
    ],
    "CameraIntrinsics": lambda w: [
        w.arm.intrinsics,
        public.CameraIntrinsics(1280, 1024, 900 + THIRD, 900 + THIRD, 639 + THIRD, 511 + THIRD),
    ],
    "Chessboard": lambda w: [public.Chessboard((9, 6), THIRD)],
    "CircleGrid": lambda w: [public.CircleGrid((4, 11), THIRD, staggered=True)],
    "HandEye": lambda w: [
        public.HandEye(*2 * (RigidTransform.identity(),), THIRD, THIRD, np.full(9, THIRD), np.full(9, THIRD), used)
        for used in (tuple(range(9)), (0, 2))
    ],
    "VirtualSphere": lambda w: [public.VirtualSphere(np.full(3, THIRD), np.float64(THIRD), (0.1, 0.2, 0.3))],
    # perception
    "Blob": lambda w: [public.Blob.from_mask(white(w.arm.capture())), public.Blob.from_mask(np.ones((9, 9), bool))],
    "GrabCut": lambda w: [
        public.GrabCut(white), public.GrabCut(), public.GrabCut(OwnSegmenter()), public.GrabCut((1, 2, 30, 40)),
    ],
    "LearnedSegmenter": lambda w: [public.LearnedSegmenter([w.arm.capture()], [white(w.arm.capture())])],
    "Whole": lambda w: [public.Whole(white), public.Whole(OwnSegmenter(), hull=True)],
    "BoxSegmenter": lambda w: [public.BoxSegmenter(white), public.BoxSegmenter(OwnSegmenter(), min_score=0.5)],
    "HsvThreshold": lambda w: [public.HsvThreshold(), public.HsvThreshold((300 + THIRD, 20), (THIRD, 2 * THIRD))],
    "Outline": lambda w: [w.plans[0].view.outline],
    "Saliency": lambda w: [public.Saliency()],
    "Tracker": lambda w: [public.Tracker(white), public.Tracker(OwnSegmenter(), choose=np.array([300.0, 200.0]))],
    # motion
    "Adjustment": lambda w: [
        public.center_on_object(w.eye), public.align_with_major_axis(w.eye), public.approach(w.eye, 0.25)
    ],
    "Arc": lambda w: list(w.plans[0].arcs),
    "Eye": lambda w: [public.Eye(w.arm, white), public.Eye(w.cell.arm, OwnSegmenter(), keep_images=True), w.eye],
    "Hand": lambda w: [w.cell.gripper.hand],
    "Motion": lambda w: [w.arm.move_camera(RigidTransform.identity())],
    "View": lambda w: [w.plans[0].view, replace(w.plans[0].view, rgb=w.picture, clipped=True)],
    # planning
    "CnnPlanner": lambda w: [public.CnnPlanner(white, OwnSegmenter()), public.CnnPlanner(w.cell.segmenter, white)],
    "FittedSolid": lambda w: w.of_plans(public.FittedSolid),
    "Grasp": lambda w: [w.grasp],
    "GraspExecutor": lambda w: [
        public.GraspExecutor(white),
        public.GraspExecutor(OwnSegmenter(), public.SizedDepth(w.of_plans(public.FittedSolid)[0])),
    ],
    "ImageMomentPlanner": lambda w: [
        public.ImageMomentPlanner(white),
        public.ImageMomentPlanner(OwnSegmenter(), public.SilhouetteFit(radius=THIRD, lean=THIRD), until=THIRD),
    ],
    "LookDown": lambda w: [public.LookDown(white), public.LookDown(OwnSegmenter(), radius=THIRD)],
    "Optimum": lambda w: [each for plan in w.plans for each in plan.optima],
    "PickUp": lambda w: [public.PickUp(plan, w.grasp, 100 * THIRD) for plan in w.plans],
    "Plan": lambda w: w.plans,
    "Quartic": lambda w: w.of_plans(public.Quartic),
    "QuarticFit": lambda w: [public.QuarticFit(), public.QuarticFit("angle", True, 6, THIRD)],
    "RangeThreshold": lambda w: [public.RangeThreshold(), public.RangeThreshold(THIRD)],
    "Reading": lambda w: list(w.grasp.readings),
    "Shape": lambda w: [public.Shape("box", np.zeros((4, 2)), False)],
    "RobustPlanner": lambda w: [public.RobustPlanner(white), public.RobustPlanner(OwnSegmenter())],
    "SpreadViews": lambda w: [public.SpreadViews(white), public.SpreadViews(OwnSegmenter(), until=THIRD, most=12)],
    "Grip": lambda w: [public.Grip(THIRD * np.ones(3), np.eye(3)[2], np.eye(3)[0], THIRD, THIRD, THIRD)],
    "VisualHull": lambda w: [public.VisualHull.of(w.plans[0].views, over_block().intrinsics)],
    "ContourFit": lambda w: [public.ContourFit(), public.ContourFit(THIRD, point_sd=THIRD)],
    "SilhouetteFit": lambda w: [public.SilhouetteFit(), public.SilhouetteFit(THIRD, THIRD, THIRD, THIRD, ("box",))],
    "SizedDepth": lambda w: [public.SizedDepth(), public.SizedDepth(w.of_plans(public.FittedSolid)[0], THIRD, THIRD)],
    "Step": lambda w: list(w.plans[-1].steps),
    "Tilt": lambda w: [public.Tilt(THIRD, THIRD, np.inf), public.Tilt(np.float64(THIRD), -THIRD, np.float64(THIRD))],
    # photographs
    "Photographs": lambda w: [w.photographs, replace(w.photographs, skipped={"a": "is HEIC"})],
    "RecordedArm": lambda w: [
        public.RecordedArm([w.picture], [RigidTransform.identity()], w.cell.arm.intrinsics),
        public.RecordedArm(["a.png"] * 99, [RigidTransform.identity()] * 99, w.cell.arm.intrinsics),
    ],
    "Sheet": lambda w: [public.Sheet(), public.Sheet("letter", bar=0.097)],
    # simulation
    "AcceptedNormal": lambda w: [w.cell.truth.normal, w.floating.truth.normal],
    "ArmSpec": lambda w: [*public.ARMS.values(), w.own_arm],
    "BoundingBox": lambda w: [public.BoundingBox(np.full(3, THIRD), np.full(3, THIRD))],
    "CanonicalNormal": lambda w: [public.CanonicalNormal((0, THIRD, 1), major_axis=(1, 0, 0), symmetry=np.pi)],
    "CellCache": lambda w: [public.CellCache(), holding(w.cell)],
    "ContactRecord": lambda w: [public.ContactRecord(), public.ContactRecord(THIRD, THIRD, 12345)],
    "EpisodeNoise": lambda w: [public.EpisodeNoise(public.Noise.thesis(), 7, np.random.SeedSequence(1))],
    "FloatingCamera": lambda w: [w.floating.arm],
    "GripperSpec": lambda w: [public.ARMS["baxter"].gripper],
    "HolonomicBase": lambda w: [public.HolonomicBase(), public.HolonomicBase(THIRD, THIRD, THIRD, THIRD, THIRD)],
    "InverseKinematics": lambda w: [public.InverseKinematics(w.own_arm)],
    "Noise": lambda w: [public.Noise(), public.Noise.thesis(), public.Noise(pixel_sd=THIRD, distortion=THIRD)],
    "ObjectSpec": lambda w: [*public.OBJECTS.values(), w.own_object],
    "RangeSensor": lambda w: [public.RangeSensor(w.cell.model, w.cell.data, 0)],
    "Rocking": lambda w: [public.Rocking(THIRD, THIRD, THIRD)],
    "SimulatedArm": lambda w: [w.cell.arm],
    "SimulatedGripper": lambda w: [w.cell.gripper],
    "Sliding": lambda w: [public.Sliding((THIRD, np.float64(THIRD)))],
    "Truth": lambda w: [w.cell.truth, w.floating.truth],
    "Turning": lambda w: [public.Turning(THIRD)],
    "WorkCell": lambda w: [w.cell, w.floating, public.WorkCell("floating", w.own_object, others=["cylinder"] * 3)],
    # learning
    "BasicBlock": lambda w: [public.BasicBlock(64, 64, 2)],
    "Bottleneck": lambda w: [public.Bottleneck(64, 64, 2)],
    "Collection": lambda w: [w.collection],
    "CollectionRecipe": lambda w: [
        public.CollectionRecipe(),
        public.CollectionRecipe(
            arm=w.own_arm, target=w.own_object, sampling="random", n=1_000_000, noise=public.Noise.thesis(),
            variation=public.Variation(light=THIRD, color=THIRD, table=THIRD, size=THIRD),
        ),
    ],
    "Collector": lambda w: [public.Collector(small())],
    "Label": lambda w: [public.label_view(w.cell.truth.world_from_camera, w.cell.truth.normal)],
    "Labels": lambda w: [public.label_views(public.VirtualSphere(np.zeros(3), 1.0).uniform(999), w.cell.truth.normal)],
    "NetworkPolicy": lambda w: [public.NetworkPolicy("actions-1x2"), public.NetworkPolicy("tilt-all")],
    "Painter": lambda w: [public.Painter(w.floating, public.Variation(light=0.2))],
    "ResNet": lambda w: [public.ResNet()],
    "TrainConfig": lambda w: [
        public.TrainConfig(),
        public.TrainConfig(
            network="resnet18_half", target="tilt", crop=240, shift=12, colors=True, step=THIRD, share=THIRD,
            optimizer="adamw", learning_rate=THIRD, weight_decay=THIRD, schedule="one cycle", patience=7, seed=2**31,
        ),
    ],
    "TrainedNetwork": lambda w: [public.load_trained("tilt-all"), w.training.trained],
    "Training": lambda w: [w.training],
    "Variation": lambda w: [public.Variation(), public.Variation(light=THIRD, color=THIRD, table=THIRD, size=THIRD)],
    "ViewpointDataset": lambda w: [public.ViewpointDataset(w.collection.folder, "all", crop=100, colors=True)],
    "ViewpointEnv": lambda w: [public.ViewpointEnv(arm="floating", target=w.own_object, noise=public.Noise.thesis())],
    # evaluation
    "AlignInPlace": lambda w: [public.AlignInPlace(white), public.AlignInPlace(OwnSegmenter(), radius=THIRD)],
    "Comparison": lambda w: [public.compare({LONG: public.Stay(w.floating.segmenter)}, w.floating, starts=1)],
    "GraspableView": lambda w: [next(w.grip_judge.views())],
    "JudgedGrip": lambda w: [w.grip_judge.grip(), public.JudgedGrip("held", THIRD, THIRD, THIRD)],
    "GripJudge": lambda w: [w.grip_judge],
    "Interval": lambda w: [public.wilson_interval(7, 9), public.Interval(np.float64(THIRD), np.float64(2 * THIRD))],
    "Judgement": lambda w: [public.judge(w.cell, w.plans[0], 100 * THIRD)],
    "Oracle": lambda w: [public.Oracle(w.cell)],
    "OracleGrasp": lambda w: [public.OracleGrasp(w.cell)],
    "Start": lambda w: [public.draw_start(w.floating, np.random.default_rng(1))],
    "Stay": lambda w: [public.Stay(white), public.Stay(OwnSegmenter())],
    "Summary": lambda w: [public.summarize(np.random.default_rng(1).normal(size=12))],
    "ViewpointError": lambda w: [public.viewpoint_error(w.cell.truth)],
    # views
    "Recording": lambda w: [recorded(w.scene)],
    "Scene3D": lambda w: [w.scene, public.Scene3D(w.cell.model)],
    "ThresholdSliders": lambda w: [public.ThresholdSliders(w.picture)],
    # jobs
    "JobResult": lambda w: [public.JobResult({"errors": [THIRD] * 99}), public.JobResult(None, "Traceback\n" * 99)],
}  # fmt: skip
"""Instances by their class: ordinary ones, and such with long names and all digits."""

PICTURED = (
    "ArmSpec", "Arc", "Blob", "Calibration", "Comparison", "FittedSolid", "Grasp", "ObjectSpec", "Optimum",
    "Photographs", "PickUp", "Plan", "Quartic", "Training", "View", "ViewpointDataset", "VirtualSphere", "WorkCell",
)  # fmt: skip
"""Classes with something to see. What their pictures show where there is next to nothing: tests/views/test_plots.py."""


def holding(cell: Any) -> Any:
    cache = public.CellCache()
    cache.get(LONG, lambda: cell)
    return cache


def recorded(scene: Any) -> Any:
    with scene.record(fps=5) as recording:
        scene.capture_frame()
    return recording


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    world = World(tmp_path_factory.mktemp("public_objects"))
    yield world
    world.cells.close()


@pytest.mark.parametrize("name", CLASSES)
def test_a_public_object_prints_as_one_short_line_without_an_address_or_an_array(world: World, name: str) -> None:
    if name not in EXAMPLES:
        pytest.fail(f"{name} needs an entry in EXAMPLES", pytrace=False)
    lines = [repr(each) for each in EXAMPLES[name](world)]
    assert lines, f"nothing came of the examples of {name}"
    for line in lines:
        if len(line) > LONGEST or BARRED.search(line):
            pytest.fail(f"{name}, {len(line)} characters: {line[: 2 * LONGEST]}", pytrace=False)


@pytest.mark.parametrize("name", PICTURED)
def test_what_has_something_to_see_shows_itself_in_a_notebook_as_a_picture_that_fits_a_page(
    world: World, name: str
) -> None:
    examples = EXAMPLES[name](world)
    assert examples
    for example in examples[:4]:
        assert callable(example.plot)
        check_picture(example._repr_png_())


def test_nothing_else_claims_to_be_a_picture() -> None:
    assert {name for name, cls in CLASSES.items() if hasattr(cls, "_repr_png_")} == {*PICTURED}


PLURAL = re.compile(r" ([a-z]+ )?[a-z]{3,}s\b")


def test_no_repr_writes_out_a_plural_that_is_wrong_of_one() -> None:
    """``count(n, "picture")`` knows which it is."""
    found = []
    for path in Path(gvp_lib.__file__).parent.rglob("*.py"):
        for method in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(method, ast.FunctionDef) and method.name in ("__repr__", "__str__"):
                texts = [node.values for node in ast.walk(method) if isinstance(node, ast.JoinedStr)]
                words = [
                    str(getattr(after, "value", ""))
                    for before, after in chain(*map(pairwise, texts))
                    if isinstance(before, ast.FormattedValue) and not before.format_spec
                ]
                found += [f"{path.name}: {word}" for word in words if PLURAL.match(word)]
    assert found == []
