"""What other libraries would hand the public calls: ten thousand odd inputs, from one seed.

Each call has arguments that are right. One of them, sometimes two, becomes something odd, of another type, shape, dtype
or range; or the same value in another form, such as a list or a view for an array. The call then refuses with a
`GvpError`, or answers; another form is answered as the plain one is. It never raises anything else, warns, or hangs.
"""

from __future__ import annotations

import inspect
import io
import os
import signal
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, redirect_stderr, redirect_stdout
from dataclasses import fields, is_dataclass
from datetime import date
from decimal import Decimal
from enum import Enum
from fractions import Fraction
from functools import cached_property
from itertools import count, islice
from pathlib import Path
from types import GeneratorType, NoneType
from typing import Any
from zlib import crc32

import cv2
import numpy as np
import pytest
import torch
from bags import bag_of
from eye_in_hand import CAMERA, white
from hands import HAND, PlainGripper, above, descent, fitted
from PIL import Image
from public_names import ROOMS, exported, is_kind_of_type, methods_of
from scipy.spatial.transform import RigidTransform, Rotation
from synthetic import arc_of_ratios, over_block
from test_docstrings import RESULTS
from test_public_objects import EXAMPLES, public, recorded, reddish
from test_public_objects import World as Examples
from tiny_training import config, lesson
from viewpoint_sets import collect, small

from gvp_lib import GvpError, cli
from gvp_lib.learning.labels import TURNS

pytestmark = pytest.mark.full

SEED = 23
TIMES, SLOW_TIMES = 40, 12  # odd inputs of each call
LIMIT, PATIENCE = 20, 120  # s of processor time, and of waiting, for one call
SOME = 3  # of what a generator gives: a judge's views are searched for as they are asked for

NOBODYS = {
    "picture.Pictured": "a class to inherit from",
    **dict.fromkeys(
        ("checks.checked", "checks.finite", "lazy.attach", "jobs.disk_errors", "jobs.open_locked", "jobs.write_file"),
        "for the library's own use",
    ),
    **dict.fromkeys(("learning.BasicBlock", "learning.Bottleneck"), "names for an Architecture"),
    **{f"learning.{net}.forward": "PyTorch's to call" for net in ("BasicBlock", "Bottleneck", "ResNet")},
    "simulation.HolonomicBase.put_under": "the cell's to call",
    "simulation.ObjectSpec.attach_to": "the scene's to call",
    **{f"simulation.SimulatedGripper.{each}": "the cell's to call" for each in ("begin_episode", "move_by")},
    "simulation.SimulatedArm.move_by": "the cell's to call",
}
"""What no user calls, and why."""


class World(Examples):
    """What arguments are made from."""

    @property
    def cell(self) -> Any:
        return self.cells("floating", "cuboid_1x2", "flat")

    @property
    def ur5e(self) -> Any:
        return self.cells("ur5e", "cuboid_1x2", "flat")

    @cached_property
    def picture(self) -> Any:
        return over_block().capture()

    @cached_property
    def numbers(self) -> Any:
        return count()

    @cached_property
    def saved(self) -> Path:
        return public.RecordedArm([self.picture], [POSE], CAMERA, POSE).write(self.folder / "saved")

    @cached_property
    def bag(self) -> Path:
        return bag_of(self.folder / "bag", [self.picture], [POSE], CAMERA)

    @cached_property
    def boards(self) -> Any:
        checks = np.kron(255 * (np.indices((6, 9)).sum(axis=0) % 2).astype(np.uint8), np.ones((20, 20), np.uint8))
        board = np.pad(checks, 20, constant_values=255)
        views = public.VirtualSphere((110, 80, 0), 280, pole=(0, 0, -1)).uniform(4, 0.5).inv().as_matrix()
        onto = [CAMERA.matrix @ np.delete(view[:3], 2, axis=1) for view in views]
        return [np.stack([cv2.warpPerspective(board, h, (640, 480), borderValue=255)] * 3, axis=-1) for h in onto]

    @cached_property
    def plan(self) -> Any:
        return public.ImageMomentPlanner(white, public.SilhouetteFit()).plan(over_block())

    @cached_property
    def view(self) -> Any:
        return public.Eye(over_block(), white).look()

    @cached_property
    def data(self) -> Path:
        return collect(self.folder / "viewpoints", small()).folder

    @cached_property
    def samples(self) -> Any:
        return public.ViewpointDataset(self.data, "all", size=32)

    @cached_property
    def training(self) -> Any:
        return lesson(self.data, self.folder / "trained", network="resnet18_half", epochs=1)

    @cached_property
    def env(self) -> Any:
        return public.ViewpointEnv(arm="floating")

    @cached_property
    def kinematics(self) -> Any:
        return public.InverseKinematics(public.ARMS["ur5e"])

    @cached_property
    def recording(self) -> Any:
        return recorded(self.scene)

    @cached_property
    def comparison(self) -> Any:
        return public.compare({"a": public.Stay(self.cell.segmenter)}, self.cell, starts=2)

    @cached_property
    def start(self) -> Any:
        return public.begin(self.cell, 0)

    @property
    def noise(self) -> Any:
        return public.EpisodeNoise(public.Noise.thesis(), 6, np.random.SeedSequence(1))


POSE = RigidTransform.from_components([0.5, 0.0, 0.4], Rotation.from_rotvec([np.pi, 0, 0]))
POSES = public.VirtualSphere((0, 0, 0), 0.5).random(6, 1)
HOME = np.array(public.ARMS["ur5e"].home)
BRICK = public.OBJECTS["cuboid_1x2"]
UP, PIXEL = np.array([0, 0.5, 1.0]), np.array([320.0, 240.0])
LESSON = config(network="resnet18_half", epochs=1)
ARC = arc_of_ratios([0.5, 0.6, 0.7, 0.8, 0.9, 0.8, 0.7, 0.6, 0.5])
TILT = public.Tilt(0.0, 0.25, sigma=0.125)
Value = Callable[[World], Any]
Call = tuple[Callable[..., Any], dict[str, Any]]

# fmt: off
ARGUMENTS: dict[str, Value] = {
    name: value if inspect.isfunction(value) and value.__name__ == "<lambda>" else lambda w, value=value: value
    for name, value in {
        "a": np.array([1.0, 2, 4]), "action": 1, "address": "tcp://127.0.0.1:9", "after": np.array([300.0, 240.0]),
        "angle": 0.125, "angles": np.array([0.25, 0.5]), "arc": ARC, "arcs": lambda w: w.plan.arcs,
        "architecture": "resnet18_half", "arm": lambda w: over_block(), "axes": np.eye(3)[1:], "azimuth": 1.0,
        "b": np.array([1.0, 1, 2]), "base": public.HolonomicBase(), "base_from_camera": POSE, "base_from_hand": POSES,
        "before": PIXEL, "blob": lambda w: w.view.blob, "blobs": lambda w: [w.view.blob],
        "calibration": lambda w: EXAMPLES["Calibration"](w)[0], "callback": print,
        "camera_from_board": POSES.inv() * POSE, "camera_from_target": RigidTransform.from_translation([0, 0, 0.01]),
        "cell": lambda w: w.cell, "channels": 4, "chosen": 1, "comparison": lambda w: w.comparison, "config": LESSON,
        "coordinates": np.random.default_rng(1).normal(size=(5, 3)), "count": 2, "crop": 128, "data": lambda w: w.data,
        "corners": np.array([[-0.016, 0.032, 0], [0.016, 0.032, 0], [0.016, -0.032, 0], [-0.016, -0.032, 0]]),
        "depth": 0.25, "device": "cpu", "direction": 0.5, "directions": np.array([0.5, 1.0]), "distance": 0.125,
        "done": 0.5, "draws": 2, "epoch": 1, "expected": PIXEL, "extents": (0.5, 0.25, 0.125),
        "eye": lambda w: public.Eye(over_block(), white), "factor": 1.25, "first": 0, "folder": lambda w: w.data,
        "fovy": 0.75, "function": abs, "grasp": lambda w: w.grasp, "gripper": lambda w: PlainGripper(above()),
        "hand": HAND, "height": 48, "image": lambda w: w.picture, "images": lambda w: [w.picture], "index": 1,
        "indices": np.array([0, 1]), "intrinsics": CAMERA, "jobs": {"a": -1}, "joints": 6, "k": 1, "k1": 0.125,
        "job": {"arm": "floating", "target": "cuboid_1x2", "placement": "flat", "noise": {"pixel_sd": 2.0}},
        "key": "a", "lens": CAMERA, "make": lambda w: lambda: w.cell, "mask": lambda w: white(w.picture),
        "masks": lambda w: [white(w.picture)], "n": 8, "name": "a", "noise": lambda w: w.noise, "normal": UP,
        "network": lambda w: w.training.trained.network, "normals": np.eye(3)[:2], "path": lambda w: w.folder / "a",
        "photographs": lambda w: w.photographs, "sheet": public.Sheet(),
        "optimum": lambda w: w.plan.optima[-1], "other": "a",
        "pictures": np.zeros((2, 8, 8, 3), np.uint8), "pixel": PIXEL, "pixels": np.array([[10.0, 20.0]]),
        "place": 1.5, "plan": lambda w: w.plan, "planner": lambda w: public.Stay(w.cell.segmenter),
        "planners": lambda w: {"a": public.Stay(w.cell.segmenter)}, "points": np.array([[0.5, 0.25, 1.0]]),
        "progress": False, "q": HOME, "q0": HOME + 0.125, "quartic": public.QuarticFit().fit(ARC), "radius": 0.25,
        "ratios": np.linspace(0, 1, 9), "reach": (0.0625, 0.5), "readings": descent(0.2, 0.19), "recipe": small(),
        "region": np.array([300, 220, 340, 260]), "result": lambda w: public.PickUp(w.plan, w.grasp, 1.0),
        "restarts": 2, "rgb": lambda w: w.picture, "rgbs": lambda w: [w.picture], "rng": 1, "rolls": 2,
        "rotation": Rotation.identity(), "rotation_vector": np.array([0.25, 0, 0]), "seconds": 0.0625, "seed": 1,
        "segmenter": white, "shape": (480, 640), "side": 128, "sigma": 0.125, "sigmas": np.array([0.25, 0.5]),
        "size": 64, "sizes": np.array([0.5, 0.5, 0.25, 0.0, 0.0]), "solid": fitted([0.05] * 3),
        "source": lambda w: w.cell, "spec": BRICK, "sphere": public.VirtualSphere((0.5, 0.0, 0.0), 0.25),
        "start": lambda w: w.start, "starts": [1], "step": 0.0625, "stride": 1, "successes": 3,
        "target": np.array([0.5, 0, 0]), "tilt": 0.5, "tilts_deg": np.linspace(-10, 10, 9), "timeout": 0.125,
        "trained": lambda w: w.training.trained, "training": lambda w: w.training, "truth": lambda w: w.cell.truth,
        "translation": np.array([0.25, 0, 0]), "turn": TURNS[1], "values": np.array([1.0, 2, 4]),
        "variation": public.Variation(light=0.25), "view": lambda w: w.view,
        "viewpoints": lambda w: public.viewpoints(small())[:2], "views": lambda w: w.plan.arcs[0].views[::3],
        "weights": lambda w: w.training.folder / "weights.safetensors",
        "width": 64, "workers": 1, "world_from_camera": POSE, "world_from_frame": POSE, "world_from_object": POSE,
    }.items()
}
"""Right arguments by a parameter's name, where its default will not do."""

SPECIAL: dict[str, Value] = {
    "evaluation.Comparison.difference.planner": lambda w: "a",
    "evaluation.Oracle.plan.arm": lambda w: w.cell.arm,
    "evaluation.GripJudge.cell": lambda w: w.cells("baxter", "cuboid_1x2", "flat"),
    "evaluation.GripJudge.views.toward": lambda w: UP,
    "planning.VisualHull.grips.look": lambda w: UP,
    "planning.VisualHull.solid.first": lambda w: w.view,
    "planning.VisualHull.solid.residual": lambda w: 9.0,
    "simulation.ObjectSpec.from_file.path": lambda w: tetrahedron(w.folder),
    "simulation.ObjectSpec.from_file.rgb": lambda w: (0.5, 0.25, 0.125),
    "evaluation.draw_start.rng": lambda w: np.random.default_rng(1),
    "evaluation.draw_start.tilt": lambda w: (10.0, 40.0),
    "evaluation.face_corners.direction": lambda w: UP,
    "geometry.CameraIntrinsics.from_fov.width": lambda w: 640,
    "geometry.board_pose.board": lambda w: public.Chessboard((8, 5), 0.025),
    "geometry.board_pose.picture": lambda w: w.boards[0],
    "geometry.calibrate.board": lambda w: (8, 5),
    "geometry.calibrate.corners": lambda w: None,
    "geometry.calibrate.pictures": lambda w: w.boards,
    "geometry.look_at.eye": lambda w: UP,
    "jobs.run_jobs.recipe": lambda w: "a",
    "jobs.run_jobs.journal": lambda w: w.folder / "journal",
    "learning.ViewpointEnv.reset.options": lambda w: {},
    "learning.ViewpointEnv.arm": lambda w: "floating",
    "learning.ViewpointEnv.target": lambda w: "cuboid_1x2",
    "learning.ViewpointEnv.noise": lambda w: public.Noise(),
    "learning.evaluate.data": lambda w: w.samples,
    "learning.decoded.image": lambda w: png(w.picture[:9, :9]),
    "learning.label_view.normal": lambda w: w.cell.truth.normal,
    "learning.label_views.normal": lambda w: w.cell.truth.normal,
    "learning.label_views.world_from_camera": lambda w: POSES,
    "learning.load_trained.path": lambda w: w.training.folder / "weights.safetensors",
    "learning.normalized.images": lambda w: torch.zeros((1, 3, 8, 8)),
    "learning.Painter.paint.rng": lambda w: np.random.default_rng(1),
    "learning.save_trained.path": lambda w: w.folder / "saved.safetensors",
    "learning.train.folder": lambda w: w.training.folder,
    "learning.ViewpointDataset.target": lambda w: "action",
    "motion.align_with_major_axis.tolerance": lambda w: 0.125,
    "perception.Outline.of.blob": lambda w: public.Blob.from_mask(white(w.picture)),
    "perception.Outline.of.image": lambda w: w.picture,
    "perception.Outline.of.count": lambda w: 12,
    "planning.ContourFit.fit.first": lambda w: w.view,
    "planning.ContourFit.fit.start": lambda w: None,
    "planning.ContourFit.foreseen.poses": lambda w: [w.view.base_from_camera],
    "photographs.views_from_photographs.files": lambda w: w.desk,
    "photographs.views_from_photographs.sheet": lambda w: public.Sheet(),
    "photographs.views_from_photographs.segmenter": lambda w: reddish,
    "photographs.views_from_photographs.lens": lambda w: None,
    "photographs.Sheet.save.path": lambda w: w.folder / "sheet.png",
    "photographs.RecordedArm.pictures": lambda w: [w.picture],
    "photographs.RecordedArm.poses": lambda w: [POSE],
    "photographs.RecordedArm.names": lambda w: ("a",),
    "photographs.RecordedArm.read.folder": lambda w: w.saved,
    "photographs.RecordedArm.write.folder": lambda w: w.folder / f"recorded-{next(w.numbers)}",
    "photographs.RecordedArm.from_bag.bag": lambda w: w.bag,
    "photographs.RecordedArm.from_bag.image": lambda w: "/image",
    "photographs.RecordedArm.from_bag.pose": lambda w: "/pose",
    "photographs.RecordedArm.from_bag.joints": lambda w: None,
    "photographs.RecordedArm.picture.k": lambda w: 0,
    "perception.GrabCut.start": lambda w: white,
    "perception.GrabCut.refined.rough": lambda w: white(w.picture),
    "perception.LearnedSegmenter.pictures": lambda w: [w.picture],
    "views.desk_scene.optimum": lambda w: w.optimum,
    "views.desk_tour.optimum": lambda w: w.optimum,
    "views.desk_tour.seconds": lambda w: 0.25,
    "views.write_desk.folder": lambda w: w.folder / "desk",
    "views.write_desk.optimum": lambda w: w.optimum,
    "planning.FittedSolid.within.share": lambda w: 0.5,
    "planning.SilhouetteFit.fit.first": lambda w: w.view,
    "planning.Tilt.toward.normal": lambda w: -UP,
    "simulation.AcceptedNormal.angle.direction": lambda w: UP,
    "simulation.AcceptedNormal.nearest.direction": lambda w: UP,
    "simulation.FloatingCamera.move_joints.q": lambda w: w.cell.arm.joints,
    "simulation.InverseKinematics.arm": lambda w: public.ARMS["ur5e"],
    "simulation.WorkCell.arm": lambda w: "floating",
    "simulation.WorkCell.target": lambda w: "cuboid_1x2",
    "simulation.WorkCell.noise": lambda w: public.Noise(),
    "simulation.WorkCell.reset.noise_seed": lambda w: np.random.SeedSequence(1),
    "simulation.looking_down.arm": lambda w: public.ARMS["ur5e"],
    "simulation.looking_down.height": lambda w: 0.375,
    "simulation.moving_target.path": lambda w: public.Sliding((0.25, 0.0)),
    "simulation.shake.cell": lambda w: w.cells("ur5e", "cuboid_1x2", "flat", dynamic=True),
    "simulation.record_contacts.cell": lambda w: w.cells("ur5e", "cuboid_1x2", "flat", dynamic=True),
    "views.ThresholdSliders.start": lambda w: public.HsvThreshold(),
    "views.gallery.height": lambda w: 1.5,
    "views.draw_blob.height": lambda w: 3.0,
    "views.show_images.height": lambda w: 3.0,
    "views.panels.height": lambda w: 2.0,
    "views.panels.width": lambda w: 6.0,
    "views.plot_arm.spec": lambda w: public.ARMS["ur5e"],
    "views.plot_dataset.data": lambda w: w.samples,
    "views.plot_sphere.viewpoints": lambda w: POSES,
    "views.Recording.save.path": lambda w: w.folder / "recording.html",
    "views.Scene3D.data": lambda w: None,
    "views.Scene3D.add_path.path": lambda w: POSES,
    "views.Scene3D.show.height": lambda w: 420,
    "views.Scene3D.record.height": lambda w: 420,
}
"""Arguments of one call that another call wants otherwise."""

RECEIVERS: dict[str, Value] = {
    "BoxSegmenter": lambda w: public.BoxSegmenter(lambda rgb: [(100, 100, 400, 400, 0.9)]),
    "CellCache": lambda w: public.CellCache(),
    "CnnPlanner": lambda w: public.CnnPlanner(white, lambda rgb: TILT, radius=0.3, max_steps=1, survey=0),
    "Collector": lambda w: public.Collector(small()),
    "Comparison": lambda w: w.comparison,
    "Eye": lambda w: public.Eye(over_block(), white),
    "FloatingCamera": lambda w: w.cell.arm,
    "HsvThreshold": lambda w: public.HsvThreshold(value=(0.5, 1.0)),
    "ImageMomentPlanner": lambda w: public.ImageMomentPlanner(white, max_angle=0.25),
    "InverseKinematics": lambda w: w.kinematics,
    "NetworkPolicy": lambda w: public.NetworkPolicy(w.training.trained),
    "RangeSensor": lambda w: public.RangeSensor((cell := w.cells()).model, cell.data, 0),
    "Recording": lambda w: w.recording,
    "RobustPlanner": lambda w: public.RobustPlanner(white),
    "Shape": lambda w: public.BOX,
    "SilhouetteFit": lambda w: public.SilhouetteFit(shapes=("box",)),
    "SimulatedArm": lambda w: w.ur5e.arm,
    "TrainConfig": lambda w: LESSON,
    "ViewpointDataset": lambda w: w.samples,
    "ViewpointEnv": lambda w: (w.env.reset(seed=1), w.env)[1],
    "WorkCell": lambda w: w.cell,
}
"""Whose method is called, where the first of its public examples will not do."""

OTHERS: dict[str, Callable[[World], Call]] = {
    "motion.Hand": lambda w: (public.Hand, shallow(HAND)),
    "evaluation.OracleGrasp.grasp": lambda w: (
        public.OracleGrasp(cell := w.cells("baxter", "cuboid_1x2", "flat", dynamic=True)).grasp,
        {"arm": cell.arm, "gripper": cell.gripper, "plan": None}),
    "planning.GraspExecutor.grasp": lambda w: (
        public.GraspExecutor(white).grasp, {"arm": (arm := above()), "gripper": PlainGripper(arm), "plan": None}),
    "planning.pick_up": lambda w: (
        public.pick_up, {"arm": (arm := above()), "gripper": PlainGripper(arm), "segmenter": white,
                         "planner": public.Stay(white), "executor": public.GraspExecutor(white)}),
    "simulation.ArmSpec": lambda w: (
        public.ArmSpec, {**shallow(public.ARMS["ur5e"]), "image_size": (640, 480), "table_height": 0.0}),
    "simulation.WorkCell.wait": lambda w: (w.ur5e.wait, {"seconds": 0.0625}),
    "views.Scene3D.capture_frame": lambda w: (capturing(w), {"time": 0.5}),
    "views.Scene3D.remove": lambda w: ((w.scene.add_frame("a", POSE), w.scene.remove)[1], {"name": "a"}),
    "views.ThresholdSliders.set": lambda w: (public.ThresholdSliders(w.picture).set, {"hue": (10.0, 20.0)}),
    "cli.main collect": lambda w: (
        command("collect", w.data), {"n": "16", "rolls": "4", "shard": "4", "seed": "1", "arm": "floating",
                                     "target": "cuboid_1x2", "placement": "flat", "sampling": "uniform",
                                     "radius": "0.5", "max_tilt": "30", "vary_light": "0", "workers": "1"}),
    "cli.main train": lambda w: (
        command("train", w.data, f"--out={w.training.folder}"),
        {"network": "resnet18_half", "size": "32", "shift": "2", "step": "20", "batch": "8", "epochs": "1",
         "optimizer": "sgd", "threads": "1", "precision": "float32", "export": w.folder / "a.safetensors"}),
}
"""Calls with arguments of their own; and the command."""
# fmt: on
SLOW = {
    "evaluation.GripJudge",
    "evaluation.GripJudge.grip",
    "evaluation.GripJudge.margin",
    "evaluation.GripJudge.views",
    "evaluation.OracleGrasp.grasp",
    "planning.VisualHull.of",
    "planning.VisualHull.grips",
    "planning.VisualHull.solid",
    "cli.main collect",
    "cli.main train",
    "evaluation.begin",
    "evaluation.compare",
    "evaluation.run_episode",
    "geometry.calibrate",
    "jobs.dask_cluster",
    "learning.Collector.collect",
    "learning.ViewpointEnv",
    "learning.ViewpointEnv.reset",
    "learning.ViewpointEnv.step",
    "learning.collect_dataset",
    "learning.evaluate",
    "learning.load_trained",
    "learning.train",
    "planning.GraspExecutor.grasp",
    "planning.ImageMomentPlanner.plan",
    "planning.RobustPlanner.plan",
    "planning.ContourFit.estimate",
    "planning.ContourFit.fit",
    "planning.ContourFit.foreseen",
    "photographs.Sheet.image",
    "photographs.Sheet.save",
    "photographs.views_from_photographs",
    "planning.SpreadViews.plan",
    "planning.SilhouetteFit.estimate",
    "perception.GrabCut",
    "perception.LearnedSegmenter",
    "perception.LearnedSegmenter.votes",
    "photographs.RecordedArm.from_bag",
    "photographs.RecordedArm.views",
    "photographs.RecordedArm.write",
    "views.desk_scene",
    "views.desk_tour",
    "views.gallery",
    "views.plot_photographs",
    "views.write_desk",
    "views.hsv_histograms",
    "views.Recording.save",
    "views.Scene3D.capture_frame",
    "views.Scene3D.record",
    "views.Scene3D.show",
    "views.Scene3D.still",
}  # fmt: skip


def tetrahedron(folder: Path) -> Path:
    """A mesh of four faces, m."""
    path = folder / "tetrahedron.obj"
    corners = "v 0 0 0\nv 0.05 0 0\nv 0 0.05 0\nv 0 0 0.05\n"
    path.write_text(corners + "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n", "utf-8")
    return path


def shallow(value: Any) -> dict[str, Any]:
    return {field.name: getattr(value, field.name) for field in fields(value) if field.init}


def command(name: str, folder: Path, *words: str) -> Any:
    def run(**options: Any) -> int:
        given = [f"--{option.replace('_', '-')}={value}" for option, value in options.items()]
        return cli.main([name, str(folder), *words, "--quiet", *given])

    return run


def capturing(world: World) -> Any:
    def capture(time: Any) -> None:
        with world.scene.record(fps=5):
            world.scene.capture_frame(time)

    return capture


def png(rgb: Any) -> bytes:
    file = io.BytesIO()
    Image.fromarray(rgb).save(file, "png")
    return file.getvalue()


def public_calls() -> dict[str, Any]:
    """Everything public that takes arguments and that a user calls, by name."""
    found: dict[str, Any] = {}
    for room in ROOMS:
        for name, value in exported(room).items():
            if is_kind_of_type(value):
                continue
            if name not in RESULTS.get(room, ()):
                found[f"{room}.{name}"] = value
            if inspect.isclass(value):
                methods = {**dict(methods_of(value)), "__call__": vars(value).get("__call__")}
                found |= {f"{room}.{name}.{each}": method for each, method in methods.items() if each != "plot"}
    return {
        name: call
        for name, call in found.items()
        if name not in NOBODYS
        and callable(call)
        and [*inspect.signature(call).parameters] not in ([], ["self"], ["cls"])
    }


CALLED = public_calls()
NAMES = sorted({*CALLED, *OTHERS})


def call_of(name: str, world: World) -> tuple[Callable[..., Any], dict[str, Any]]:
    """A call, and arguments that are right."""
    if name in OTHERS:
        return OTHERS[name](world)
    call, (_, owner, *method) = CALLED[name], name.split(".")
    if is_dataclass(call):
        return call, shallow(EXAMPLES[owner](world)[0])
    if method:
        classmethod_ = isinstance(inspect.getattr_static(getattr(public, owner), method[0]), classmethod)
        receiver = RECEIVERS.get(owner, lambda w: EXAMPLES[owner](w)[0])
        call = getattr(getattr(public, owner) if classmethod_ else receiver(world), method[0])
    arguments = {}
    for parameter in inspect.signature(call).parameters.values():
        value = SPECIAL.get(f"{name}.{parameter.name}") or ARGUMENTS.get(parameter.name)
        if parameter.kind not in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL):
            if value is None and parameter.default is parameter.empty:
                pytest.fail(f"{name} needs an argument {parameter.name!r} in ARGUMENTS or SPECIAL", pytrace=False)
            arguments[parameter.name] = parameter.default if value is None else value(world)
    return call, arguments


class Strange(Enum):
    MEMBER = 1


_PLAIN = (
    None, True, False, "", "abc", "a\0b", "nan", b"", b"abc", 0, 1, -1, 7, 2**63, 10**30, -(10**30), 10**400, 0.0, -0.0,
    0.5, 1e-320, -1e-3, 1e300, -1e300, np.nan, np.inf, -np.inf, 1j, Decimal("0.25"), Fraction(1, 4), np.float32("nan"),
    np.float64("inf"), np.int8(-5), np.uint64(2**64 - 1), np.datetime64("2020-01-01"), date(2020, 1, 1), slice(3), ...,
    NotImplemented, object, int, abs, white, Strange.MEMBER, Path("nowhere/at all"), CAMERA,
)  # fmt: skip
ODD: list[Callable[[], Any]] = [
    *(lambda value=value: value for value in _PLAIN),
    # collections
    object, list, tuple, dict, set, lambda: {"a": 1}, lambda: {"a": np.zeros(3)}, lambda: iter([1.0, 2.0, 3.0]),
    lambda: (x for x in (1, 2)), lambda: [None], lambda: ["a", "b", "c"], lambda: [1, 2], lambda: (2.0, 1.0),
    lambda: (640.0, 480.0), lambda: [[1.0], [2.0, 3.0]], lambda: [1e300] * 3, lambda: [np.nan] * 3,
    lambda: [10**400] * 3, lambda: (np.zeros(3), np.zeros(3)),
    # arrays
    lambda: np.array([]), lambda: np.zeros((0, 3)), lambda: np.zeros(3), lambda: np.zeros((3, 3)), lambda: np.eye(3),
    lambda: np.full((3, 4), np.nan), lambda: np.full(3, np.inf), lambda: np.full(2, 1e300),
    lambda: np.zeros((2, 3, 4, 5)), lambda: np.ones((4, 1, 2), np.float32), lambda: np.array(0.25),
    lambda: np.array([0.25]), lambda: np.array(None), lambda: np.array([None, 1.0, "x"], object),
    lambda: np.array(["a", "b", "c"]), lambda: np.ones(3, complex), lambda: np.array([(1, 2.0)], "i4,f8"),
    lambda: np.array(["2020-01-01"], "M8[D]"), lambda: np.ma.masked_array([1.0, 2], [0, 1]),
    lambda: torch.zeros(3), lambda: torch.tensor(0.25), lambda: torch.zeros(3, requires_grad=True),
    # pictures and masks
    lambda: np.zeros((480, 640)), lambda: np.zeros((480, 640, 4), np.uint8), lambda: np.zeros((3, 480, 640), np.uint8),
    lambda: np.zeros((480, 640, 3), np.float16), lambda: np.zeros((480, 640, 3), np.uint16),
    lambda: np.zeros((1, 1, 3), np.uint8), lambda: np.zeros((0, 0, 3), np.uint8), lambda: np.zeros((480, 640), bool),
    lambda: np.zeros((1, 480, 640), bool), lambda: torch.zeros((3, 48, 64)), lambda: Image.new("RGB", (64, 48)),
    lambda: Image.new("P", (64, 48)),
    # poses
    lambda: np.eye(4), lambda: np.zeros((4, 4)), lambda: np.full((4, 4), np.nan), lambda: [np.eye(4)] * 3,
    Rotation.identity, lambda: Rotation.identity(3), RigidTransform.identity, lambda: RigidTransform.identity(3),
    lambda: RigidTransform.identity(0), lambda: [RigidTransform.identity()] * 3,
    lambda: RigidTransform.from_translation([np.nan] * 3),
    # what draws at random, and what moves
    lambda: np.random.RandomState(1), lambda: np.random.SeedSequence(1), lambda: np.random.default_rng(1),
    lambda: over_block(),
]  # fmt: skip
"""What may stand for anything."""


def forms(value: Any, world: World) -> list[tuple[Any, Any]]:
    """Other forms of a value, and each one's plain form."""
    if isinstance(value, bool):
        return [(np.bool_(value), value), (int(value), value)]
    if isinstance(value, int):
        return [(kind(value), value) for kind in (np.int64, np.int16, np.array, float, np.float32)] + [
            (np.uint16(abs(value)), abs(value)), (torch.tensor(value), value)
        ]  # fmt: skip
    if isinstance(value, float):
        if not np.isfinite(value):
            return [(np.float32(value), value)]
        found = [(kind(value), value) for kind in (np.float64, np.array, torch.tensor, Decimal, Fraction)]
        narrow = [np.float32(value), np.float16(value), round(value)]
        return found + [(each, float(each)) for each in narrow]
    if isinstance(value, np.ndarray):
        return array_forms(value, world)
    if isinstance(value, str):
        return [(np.str_(value), value)]
    if isinstance(value, Path):
        return [(str(value), value)]
    if isinstance(value, RigidTransform):
        many = [] if value.single else [(list(value), value), (list(value.as_matrix()), value)]
        return [(value.as_matrix(), value), (value.as_matrix().tolist(), value), *many]
    if isinstance(value, tuple):
        return [(list(value), value)] + (
            [(np.array(value), value)] if all(isinstance(x, float | int) for x in value) else []
        )
    if isinstance(value, list):
        return [(tuple(value), value)]
    return []


def array_forms(value: Any, world: World) -> list[tuple[Any, Any]]:
    file = world.folder / "array"
    value.tofile(file)
    frozen, strided = value.copy(), np.repeat(value, 2, axis=0)[::2]
    frozen.flags.writeable = False
    plain = value.astype(float) if value.dtype.kind == "f" else value
    same = [
        np.asfortranarray(value), value[::-1].copy()[::-1], strided, frozen,
        value.astype(value.dtype.newbyteorder(">")), np.memmap(file, value.dtype, "r", shape=value.shape),
        torch.from_numpy(value.copy()), np.ma.masked_array(value),
    ]  # fmt: skip
    if value.size < 100:
        same += [value.tolist(), tuple(value.tolist()), list(value), value.astype(object)]
    elif value.dtype == np.uint8 and value.ndim == 3:
        same += [Image.fromarray(value), value.astype(np.uint16), value.astype(np.int64)]
    found = [(each, plain) for each in same]
    if value.dtype.kind == "f":
        for kind in (np.float32, np.float16, np.int64, np.longdouble):
            found.append((value.astype(kind), value.astype(kind).astype(float)))
    return found


class TooLong(BaseException):
    pass


def ring(*_: Any) -> None:
    raise TooLong(f"no answer in {LIMIT} s of processor time, or {PATIENCE} s in all")


def answer(call: Callable[..., Any], arguments: dict[str, Any]) -> Any:
    """What a call gives, a generator's first few, a context's inside; or the `GvpError`."""
    quiet = io.StringIO()
    for limit in (signal.SIGPROF, signal.SIGALRM):
        signal.signal(limit, ring)
    signal.setitimer(signal.ITIMER_PROF, LIMIT)
    signal.alarm(PATIENCE)
    try:
        with warnings.catch_warnings(), redirect_stdout(quiet), redirect_stderr(quiet):
            warnings.simplefilter("error")
            given = call(**arguments)
            if isinstance(given, GeneratorType):
                return list(islice(given, SOME))
            if isinstance(given, AbstractContextManager) and hasattr(given, "gen"):
                with given as inside:
                    return inside
            return given
    except GvpError as refusal:
        return refusal
    except SystemExit as end:
        return end.code
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.alarm(0)


ONCE = {"photographs.RecordedArm.write"}
"""Calls that refuse to be made again: what is written stays."""


def same(a: Any, b: Any) -> bool:
    """Whether two answers say the same, in numbers and in parts."""
    if isinstance(a, RigidTransform) and isinstance(b, RigidTransform):
        a, b = a.as_matrix(), b.as_matrix()
    if isinstance(a, Rotation) and isinstance(b, Rotation):
        a, b = a.as_matrix(), b.as_matrix()
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray) and a.dtype.kind in "biuf":
        return a.shape == b.shape and bool(np.allclose(a, b, rtol=1e-6, atol=1e-9, equal_nan=True))
    if isinstance(a, int | float | np.number) and isinstance(b, int | float | np.number):
        return bool(np.isclose(a, b, rtol=1e-6, atol=1e-9, equal_nan=True))
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, Path) or isinstance(b, Path):
        return str(a) == str(b)
    if isinstance(a, dict) and isinstance(b, dict):
        return [*a] == [*b] and all(same(a[key], b[key]) for key in a)
    if is_dataclass(a) and type(a) is type(b):
        return all(same(getattr(a, field.name), getattr(b, field.name)) for field in fields(a))
    if isinstance(a, str | bytes | NoneType) or isinstance(b, str | bytes | NoneType):
        return a == b
    return type(a) is type(b)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    folder, before = tmp_path_factory.mktemp("fuzz"), Path.cwd()
    os.chdir(folder)  # an odd text may well name a file to write
    world = World(folder)
    yield world
    world.cells.close()
    os.chdir(before)


def faults(name: str, world: World, times: int) -> Iterator[str]:
    """What escaped from a call, or was answered in another way than the plain form."""
    rng = np.random.default_rng([SEED, crc32(name.encode())])
    right = answer(*call_of(name, world))
    if isinstance(right, GvpError) and name != "jobs.dask_cluster":  # where no scheduler answers
        yield f"{name} with right arguments: {right!r}"
    for _ in range(times):
        call, arguments = call_of(name, world)
        parameter = str(rng.choice([*arguments]))
        others = forms(arguments[parameter], world)
        if others and rng.uniform() < 0.3:
            odd, plain = others[rng.integers(len(others))]
        else:
            odd, plain = ODD[rng.integers(len(ODD))](), ...
        arguments[parameter] = odd
        if plain is ... and rng.uniform() < 0.2:
            arguments[str(rng.choice([*arguments]))] = ODD[rng.integers(len(ODD))]()
        kind = f"{odd.dtype} {odd.shape} " if isinstance(odd, np.ndarray | torch.Tensor) else ""
        text = f"{name}({parameter}={type(odd).__name__} {kind}{odd!r:.60}): ".replace("\n", " ")
        try:
            got = answer(call, arguments)
        except (Exception, TooLong) as escaped:
            if inspect.isroutine(odd) and isinstance(escaped, TypeError):
                continue  # where a function is wanted, its own error
            yield f"{text}{type(escaped).__name__}: {escaped}"
            continue
        if plain is not ... and name not in ONCE and not isinstance(got, GvpError):
            call, arguments = call_of(name, world)
            expected = answer(call, {**arguments, parameter: plain})
            if not same(got, expected):
                yield f"{text}answered {got!r:.99} and not {expected!r:.99}"


def test_the_inputs_are_ten_thousand() -> None:
    assert sum(SLOW_TIMES if name in SLOW else TIMES for name in NAMES) >= 10_000


@pytest.mark.parametrize("name", NAMES)
def test_an_odd_input_is_refused_in_words_or_answered_as_its_plain_form(world: World, name: str) -> None:
    found = list(faults(name, world, SLOW_TIMES if name in SLOW else TIMES))
    assert not found, "\n".join(found)
