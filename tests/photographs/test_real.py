"""Fits on what was measured in real pictures: a telephone's of a carton, and a real arm's of a tissue box."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_book.measured import Box, carton, tissue_box, view_of
from gvp_lib import ContourFit, SilhouetteFit
from gvp_lib.planning import FittedSolid


def off(solid: FittedSolid, box: Box) -> tuple[float, float]:
    """Largest angle between axes of a fitted box and of one by hand, deg; largest difference of their lengths, mm."""
    along = np.abs(solid.base_from_solid.rotation.as_matrix().T @ box.base_from_box.rotation.as_matrix())
    which = along.argmax(axis=0)
    assert sorted(which) == [0, 1, 2]
    angle = np.degrees(np.arccos(along.max(axis=0).clip(max=1))).max()
    return float(angle), float(1000 * np.abs(solid.lengths[which] - box.sizes).max())


def test_a_real_carton_is_within_a_degree_of_the_box_by_hand() -> None:
    measured, box = carton()
    solid = ContourFit().fit(measured.views, measured.intrinsics)
    angle, size = off(solid, box)
    assert solid.explains
    assert solid.kind == "box"
    assert angle <= 1.0
    assert size <= 2.5


@pytest.mark.parametrize("seed", range(10))
def test_any_five_of_its_views_do(seed: int) -> None:
    measured, box = carton()
    chosen = np.random.default_rng(seed).choice(len(measured.views), 5, replace=False)
    solid = ContourFit().fit([measured.views[k] for k in chosen], measured.intrinsics)
    assert solid.explains
    assert off(solid, box)[0] <= 1.5


@pytest.mark.parametrize("count", [8, 12, 40])
@pytest.mark.parametrize("seed", range(4))
def test_without_what_the_print_takes_out_it_is_right_or_not_explained(count: int, seed: int) -> None:
    measured, box = carton("largest_region")
    chosen = np.random.default_rng(seed).choice(len(measured.views), count, replace=False)
    solid = ContourFit().fit([measured.views[k] for k in chosen], measured.intrinsics)
    assert off(solid, box)[0] <= 2.5 if solid.explains else not solid.explains


@pytest.mark.parametrize("fit", [ContourFit(), SilhouetteFit()], ids=lambda fit: type(fit).__name__)
@pytest.mark.parametrize("poses", ["arm_poses", "calibrated_poses"])
def test_a_real_arms_box_is_claimed_as_well_as_the_arm_allows(poses: str, fit: ContourFit | SilhouetteFit) -> None:
    measured, normal = tissue_box(poses)
    solid = fit.fit(fit.usable(measured.views), measured.intrinsics)
    claimed = solid.within(0.95)
    assert solid.kind == "box"
    assert np.arccos(solid.normal @ normal) <= claimed <= np.radians(12)


@pytest.mark.parametrize(
    ("fit", "near", "wider"), [(ContourFit(), 1.2, 2.0), (SilhouetteFit(), 2.5, 1.3)], ids=["outlines", "moments"]
)
@pytest.mark.parametrize("seed", range(3))
def test_of_an_arm_far_off_its_word_the_claim_widens_and_of_one_near_it_does_not(
    seed: int, fit: ContourFit | SilhouetteFit, near: float, wider: float
) -> None:
    measured, _ = tissue_box()
    lens, rng = measured.intrinsics, np.random.default_rng(seed)
    true = ContourFit().fit(measured.views, lens)
    cameras = [view.base_from_camera for view in measured.views]
    claims = []
    for times in (1.0, 3.0):
        views = []
        for camera in cameras:
            seen = cv2.convexHull(lens.project(camera.inv().apply(true.corners)).astype(np.float32))[:, 0]
            turn, shift = times * rng.normal(0, np.radians(0.25), 3), times * rng.normal(0, 0.002, 3)
            off_by = RigidTransform.from_components(shift, Rotation.from_rotvec(turn))
            views.append(view_of(seen, camera * off_by, lens))
        solid = fit.fit(views, lens)
        assert np.arccos(abs(solid.normal @ true.normal)) < solid.within(0.95)
        claims.append(solid.uncertainty)
    assert claims[0] < np.radians(near)
    assert claims[1] > wider * claims[0]
