"""How well the judge of grips agrees with grasps under physics, from views that nobody chose.

Run as ``python tests/benchmarks/grips.py``. Aim: of 200 grasps, judge and physics agree on 95 %, the alligator among
them. The objects are Table 3.2's and the two dozen things; each stands alone, flat or leaning on a block. Views are up
to 40 deg off the aligned one, in any direction and at any roll, the object in the middle of the image. The hand is the
Baxter's, carried by three slides and three hinges, so that no arm's reach plays a part; it descends along its optical
axis as far as the judge says, closes, and lifts. Held is what is 5 cm higher then, and 2 s later. With ``--views`` it
tries the judge's best view of each object instead.
"""

from __future__ import annotations

import os

os.environ["LP_NUM_THREADS"] = "1"  # of software rendering; before anything draws
import gvp_lib.simulation  # noqa: F401 - before mujoco, which then chooses how it draws

# isort: split
import argparse
import warnings
import zlib
from collections import Counter
from collections.abc import Iterator

import mujoco
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_book.experiments.grasping import HELD_FOR, LIFTED, THESIS
from gvp_book.experiments.things import THINGS
from gvp_lib import ARMS, ArmSpec, WorkCell
from gvp_lib.errors import GvpError
from gvp_lib.evaluation import GripJudge, JudgedGrip, OracleGrasp, canonical_views, wilson_interval
from gvp_lib.motion import Eye, center_on_object
from gvp_lib.simulation.objects import adopt_settings

PLACEMENTS = ("flat", "tilted")
TILT, LEVEL, AHEAD = 40.0, 75.0, 0.25  # deg, off the aligned view and off the vertical at the most; m
EACH, THINGS_EACH = 8, 5  # grasps of each of the thesis's objects in each placement, and of each thing


def carried_hand() -> ArmSpec:
    """The Baxter's hand on stiff servos: three slides and three hinges in one point."""
    baxter, scene = ARMS["baxter"], mujoco.MjSpec()
    model = baxter.load()
    adopt_settings(scene, model)
    scene.compiler.degree = model.compiler.degree = False
    body = scene.worldbody
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    axes = dict(zip(("x", "y", "z", "pitch", "tip", "roll"), np.eye(3)[[0, 1, 2, 1, 0, 2]], strict=True))
    for name, axis in axes.items():
        slides = len(name) == 1
        body = body.add_body(name=name, gravcomp=1.0)
        body.explicitinertial, body.mass, body.inertia = True, 0.1, np.full(3, 1e-4)
        body.ipos, body.iquat = (0, 0, 0), (1, 0, 0, 0)
        limit = 1.5 if slides or name != "roll" else 2 * np.pi
        armature, stiffness = (2.0, 2e4) if slides else (0.1, 2e3)
        body.add_joint(name=name, type=slide if slides else hinge, axis=axis, range=(-limit, limit), armature=armature)
        servo = scene.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, ctrlrange=(-limit, limit))
        servo.set_to_position(kp=stiffness, kv=2 * np.sqrt(stiffness * armature))
    body.add_frame(quat=(0, 1, 0, 0)).attach_body(model.body("gripper"), "", "")  # z down
    with warnings.catch_warnings(action="ignore", category=UserWarning):  # of names without a prefix
        scene.compile()
        text = scene.to_xml()
    return ArmSpec(
        name="carried hand",
        mjcf=text,
        camera=baxter.camera,
        joints=tuple(axes),
        home=(0.0, 0.0, 0.42, 0.0, 0.0, 0.0),
        workspace=((-0.05, 0.05), (-0.05, 0.05)),
        joint_speed=(1.0, 1.0, 1.0, 3.0, 3.0, 3.0),
        gripper=baxter.gripper,
    )


def cases() -> Iterator[tuple[str, str, int]]:
    """Object, placement and number of each grasp."""
    for name in THESIS:
        yield from ((name, placement, k) for placement in PLACEMENTS for k in range(EACH))
    for i, name in enumerate(THINGS):
        yield from sorted((name, PLACEMENTS[(i + k) % 2], k) for k in range(THINGS_EACH))


def begin(cell: WorkCell, seed: int, k: int) -> None:
    """Place the object and the camera, by the seed alone."""
    case = zlib.crc32(f"{cell.target_spec.name} {cell.placement}".encode())
    places, draws = np.random.SeedSequence([seed, case, k]).spawn(2)
    cell.dynamic = False
    cell.reset(places)
    rng, ahead = np.random.default_rng(draws), RigidTransform.from_translation([0.0, 0.0, AHEAD])
    while True:
        aligned = canonical_views(cell)
        azimuth, roll = rng.uniform(0, 2 * np.pi, 2)
        tilt = np.radians(rng.uniform(0, TILT)) * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        turn = RigidTransform.from_rotation(Rotation.from_rotvec(tilt) * Rotation.from_rotvec([0.0, 0.0, roll]))
        view = aligned[rng.integers(len(aligned))] * ahead * turn * ahead.inv()
        if view.rotation.as_matrix()[2, 2] > -np.cos(np.radians(LEVEL)):
            continue
        try:
            cell.place_camera(view)
        except GvpError:
            continue  # the hand would stand in something
        if center_on_object(Eye(cell.arm, cell.segmenter)).outcome == "reached":
            return


def judged_and_held(cell: WorkCell) -> tuple[JudgedGrip, bool, str]:
    """What the judge says of the view, whether a grasp from it holds, and what the hand thinks came of it."""
    placed = cell.truth.world_from_object.translation[2]
    grip = GripJudge(cell).grip()
    cell.dynamic = True
    outcome = OracleGrasp(cell).grasp(cell.arm, cell.gripper).outcome.value
    held = cell.truth.world_from_object.translation[2] - placed >= LIFTED
    if held:
        cell.wait(HELD_FOR)
        held = cell.truth.world_from_object.translation[2] - placed >= LIFTED
    return grip, bool(held), outcome


def best_views(hand: ArmSpec, seed: int) -> None:
    """Whether the judge's best view holds, of each object and placement; print where not."""
    held, odd, n = 0, 0, 0
    for placement in (*PLACEMENTS, "ramp"):
        for name in ("alligator", "cylinder", *THINGS):
            try:
                cell = WorkCell(hand, THINGS.get(name, name), placement, seed=seed)
            except GvpError:
                print(f"{name} {placement}: does not come to rest", flush=True)
                continue
            judge = GripJudge(cell)
            odd, n = odd + (not any(judge.grip(view) for view in canonical_views(cell))), n + 1
            best = next(judge.views(), None)
            if best is not None:
                cell.place_camera(best.world_from_camera)
                _, holds, outcome = judged_and_held(cell)
                held += holds
            if best is None or not holds:
                print(f"{name} {placement}: {best}{f', {outcome} by physics' if best else ''}", flush=True)
            cell.close()
    print(f"best views: {held} of {n} held; {odd} of {n} have no canonical view that would")


def main() -> None:
    """Print every disagreement, and how many agree."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=4)
    parser.add_argument("--only", help="name of one object")
    parser.add_argument("--views", action="store_true", help="try the best view of each object instead")
    arguments = parser.parse_args()
    if arguments.views:
        return best_views(carried_hand(), arguments.seed)
    hand, cell, found = carried_hand(), None, Counter[tuple[str, bool, bool]]()
    for name, placement, k in cases():
        if arguments.only not in (None, name):
            continue
        if cell is None or (cell.target_spec.name, cell.placement) != (name, placement):
            if cell is not None:
                cell.close()
            cell = WorkCell(hand, THINGS.get(name, name), placement)
        begin(cell, arguments.seed, k)
        grip, held, outcome = judged_and_held(cell)
        found[name, bool(grip), held] += 1
        if bool(grip) is not held:
            print(f"{name} {placement} {k}: {grip}, {'held' if held else outcome} by physics", flush=True)
    groups = {"alligator": ["alligator"], "thesis's": THESIS, "things": THINGS, "all": [*THESIS, *THINGS]}
    for title, names in groups.items():
        pairs = (True, True), (False, False), (True, False), (False, True)
        both, neither, too_many, too_few = (sum(found[name, *pair] for name in names) for pair in pairs)
        if n := both + neither + too_many + too_few:
            share = wilson_interval(both + neither, n)
            print(
                f"{title}: {both + neither} of {n} agree, {share.low:.1%} to {share.high:.1%}: {both} held, {neither} "
                f"not; {too_many} were judged held and were not, {too_few} the reverse"
            )


if __name__ == "__main__":
    main()
