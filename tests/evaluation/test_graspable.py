from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_book.experiments.things import THINGS
from gvp_lib import WorkCell
from gvp_lib.errors import ModelError
from gvp_lib.evaluation import GripJudge, Oracle, OracleGrasp, canonical_views

WIDTH = 0.0318  # m, of a brick


@cache
def brick() -> tuple[WorkCell, GripJudge, RigidTransform]:
    cell = WorkCell(target="cuboid_1x4", seed=3)
    return cell, GripJudge(cell), canonical_views(cell)[0]


def moved(x: float = 0.0, y: float = 0.0, z: float = 0.0, roll: float = 0.0) -> RigidTransform:
    return RigidTransform.from_components([x, y, z], Rotation.from_rotvec([0.0, 0.0, np.radians(roll)]))


@pytest.mark.parametrize(
    ("displaced", "outcome"),
    [
        (moved(), "held"),
        (moved(y=0.04), "held"),  # at its end, across the same width
        (moved(roll=20), "held"),
        (moved(roll=90), "too wide"),
        (moved(x=0.015), "slipped"),  # one finger pushes it away before the other is there
        (moved(x=0.03), "too wide"),  # one lands on it
        (moved(y=0.1), "closed on nothing"),
    ],
)
def test_a_brick_is_held_across_its_width_alone(displaced: RigidTransform, outcome: str) -> None:
    cell, judge, view = brick()
    before, groups = cell.data.qpos.copy(), cell.model.geom_group.copy()
    grip = judge.grip(view * displaced)
    assert grip.outcome == outcome
    if displaced.rotation.magnitude() == 0 and grip:
        assert grip.width == pytest.approx(WIDTH, abs=1e-4)
        assert grip.turn == 0
    np.testing.assert_array_equal(cell.data.qpos, before)
    np.testing.assert_array_equal(cell.model.geom_group, groups)


def test_what_turns_between_the_pads_lies_flush_and_no_hand_is_none() -> None:
    _, judge, view = brick()
    found = [judge.grip(view * moved(roll=roll)) for roll in range(0, 60, 5)]
    turns = [grip.turn for grip in found if grip]
    assert max(turns) > 0
    assert turns == sorted(turns)
    assert judge.margin(view) == 1
    with pytest.raises(ModelError, match="has no gripper"):
        GripJudge(WorkCell("floating"))


def test_a_hand_comes_down_no_farther_than_the_table_lets_it() -> None:
    cell, judge, view = brick()
    low = view * moved(z=0.02)
    assert judge.grip(low).travel == pytest.approx(judge.grip(view).travel - 0.02, abs=1e-6)
    tips = cell.gripper.hand.tips
    for tilt in (0, 30, 60):
        turned = view * moved(z=0.25) * RigidTransform.from_rotation(Rotation.from_rotvec([np.radians(tilt), 0, 0]))
        grip = judge.grip(turned * moved(z=-0.25))
        end = (turned * moved(z=grip.travel + tips - 0.25)).translation[2]
        assert end > cell.stage.table_height


def test_what_cannot_be_grasped_by_its_boxs_face_is_held_from_the_best_view() -> None:
    cell = WorkCell(target=THINGS["drill"], seed=3)
    judge = GripJudge(cell)
    assert not any(judge.grip(view) for view in canonical_views(cell))
    assert Oracle(cell, graspable=True).plan(cell.arm).outcome.arrived
    assert GripJudge(cell).margin() > 0.5
    before, cell.dynamic = cell.truth.world_from_object.translation[2], True
    assert OracleGrasp(cell).grasp(cell.arm, cell.gripper).held
    assert cell.truth.world_from_object.translation[2] > before + 0.05
