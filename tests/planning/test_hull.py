"""The visual hull of what no box and no can explains: its smallest box, and where a hand may grip it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hands import fitted
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_book.experiments.things import THINGS
from gvp_lib import Noise, SpreadViews, VirtualSphere, WorkCell
from gvp_lib.errors import InvalidParameterError
from gvp_lib.evaluation import begin
from gvp_lib.motion import Eye
from gvp_lib.perception import Blob
from gvp_lib.planning.hull import VisualHull
from gvp_lib.planning.room import Room

AROUND = [(0.2, 0.0)] + [(tilt, k * 2 * np.pi / 7) for k, tilt in enumerate([0.9, 1.0] * 3 + [0.9])]


@cache
def seen(name, placement="tilted", others=()):
    """Eight views about an object's accepted normal, their cameras' true poses, the object's axes, and the lens."""
    target, rng = THINGS.get(name, name), np.random.default_rng(1)
    beside = [THINGS[other] for other in others]
    with WorkCell("floating", target, placement, noise=Noise.thesis(), others=beside, touching=True) as cell:
        begin(cell, 1, 4711)
        truth, eye, views, true = cell.truth, Eye(cell.arm, cell.segmenter), [], []
        sphere = VirtualSphere(truth.world_from_object.translation + 0.003, 0.25, truth.normal.direction)
        for tilt, azimuth in AROUND:
            cell.place_camera(sphere.viewpoint(tilt, azimuth, 3 * azimuth))
            eye.expect(None)
            view = eye.look(eye.intrinsics.principal_point)
            off = RigidTransform.from_components(
                rng.normal(0, 0.002, 3), Rotation.from_rotvec(rng.normal(0, np.radians(0.25), 3))
            )
            true.append(truth.world_from_camera)
            views.append(replace(view, base_from_camera=true[-1] * off))
        return views, true, truth.world_from_object.rotation.as_matrix(), cell.arm.intrinsics


def angle(axes, direction):
    """Between a direction and the nearest of an object's axes, deg."""
    return np.degrees(np.arccos(min(1.0, np.abs(axes.T @ direction).max())))


@pytest.mark.parametrize(
    ("name", "placement"),
    [("alligator", "flat"), ("alligator", "tilted"), ("bracket", "flat"), ("drill", "flat"), ("wedge", "tilted")],
)
def test_a_face_of_the_smallest_box_is_one_of_the_objects(name, placement):
    views, _, axes, lens = seen(name, placement)
    hull = VisualHull.of(views, lens)
    solid = hull.solid(views[0], residual=9.0)
    assert not solid.explains
    assert hull.covered > 0.95
    assert angle(axes, solid.normal) < min(11, 2.5 * np.degrees(solid.uncertainty))


def test_the_views_are_shifted_to_where_they_were_taken_but_for_what_they_share():
    views, true, _, lens = seen("drill", "flat")
    corrections = VisualHull.of(views, lens).corrections
    off = [
        [
            view.base_from_camera.apply(shift) - pose.translation
            for view, pose, shift in zip(views, true, shifts, strict=True)
        ]
        for shifts in (np.zeros_like(corrections), corrections)
    ]
    before, after = np.linalg.norm(off - np.mean(off, axis=1, keepdims=True), axis=2).mean(axis=1)
    assert after < 0.75 * before  # toward the object, a shift changes next to nothing


def test_a_view_of_which_a_part_is_hidden_is_left_out():
    views, _, _, lens = seen("shoe", "flat")
    mask = views[3].blob.mask((lens.height, lens.width))
    mask[:, int(views[3].blob.centroid[0]) :] = False
    spoilt = [*views[:3], replace(views[3], blob=Blob.from_mask(mask)), *views[4:]]
    hull, whole = VisualHull.of(spoilt, lens), VisualHull.of(views, lens)
    assert not hull.corrections[3].any()
    np.testing.assert_allclose(np.sort(hull.lengths), np.sort(whole.lengths), atol=0.006)
    assert hull.uncertainties.mean() > whole.uncertainties.mean()


@pytest.mark.parametrize(("name", "across", "width"), [("cuboid_1x4", 1, 0.032), ("rubber", 1, 0.036)])
def test_the_fingers_close_across_the_narrow_side_and_the_object_is_no_wider(name, across, width):
    views, _, axes, lens = seen(name, "flat")
    grip, *others = VisualHull.of(views, lens).grips((0, 0, 2))
    assert width - 0.001 < grip.width < width + 0.011
    assert np.abs(axes[:, across] @ grip.closing) > np.cos(np.radians(16))
    assert grip.hold > 0.4
    assert all(abs(other.closing @ grip.closing) < np.cos(np.radians(30)) for other in others)
    pose = grip.view(0.25)
    np.testing.assert_allclose(pose.apply([0, 0, 0.25]), grip.center, atol=1e-9)
    np.testing.assert_allclose(pose.rotation.as_matrix()[:, [0, 2]].T, [grip.closing, [0, 0, -1]], atol=1e-9)


def test_what_is_wider_than_the_fingers_can_span_has_no_grip():
    views, _, _, lens = seen("wedge", "flat")
    assert VisualHull.of(views, lens).grips((0, 0, 1), (0.01, 0.03)) == ()


def test_grips_keep_clear_of_what_stands_beside():
    views, _, _, lens = seen("rubber", "flat", ("tin", "soap"))
    hull = VisualHull.of(views, lens)
    free, regardless = hull.grips((0, 0, 1))[0], replace(hull, room=None).grips((0, 0, 1))[0]

    def crowding(grip):
        closing = np.column_stack([grip.closing, np.cross(grip.look, grip.closing), grip.look])
        tips = grip.center - 0.5 * grip.depth * grip.look
        return hull.room.crowding(tips[None], closing, 0.072)[0]

    assert free.room == pytest.approx(1 - crowding(free))
    assert regardless.room == 1
    assert crowding(free) <= crowding(regardless)


def test_what_some_view_shows_the_table_through_is_empty_and_what_hides_it_in_all_is_not():
    with WorkCell("floating", "cuboid_1x2", "flat", seed=3) as cell:
        center, lens, views = cell.truth.world_from_object.translation, cell.arm.intrinsics, []
        for tilt, azimuth in AROUND:
            cell.place_camera(VirtualSphere(center, 0.25).viewpoint(tilt, azimuth))
            views.append(Eye(cell.arm, cell.segmenter).look())
        axes = cell.truth.world_from_object.rotation.as_matrix()
    room = Room.of(views, lens)
    along, across = axes[:, 0], axes[:, 1]
    inside = center + np.outer(np.linspace(-0.02, 0.02, 5), along)
    beside = center + 0.035 * across + np.outer(np.linspace(-0.02, 0.02, 5), along)
    assert room.taken(inside).all()
    assert not room.taken(beside).any()
    assert not room.taken(center + [[0, 0, 5.0]]).any()  # in no picture: nobody knows
    bare = [replace(view, thumbnail=None) for view in views]
    assert Room.of(bare, lens) is None
    assert VisualHull.of(bare, lens).grips((0, 0, 1))[0].room == 1


@pytest.mark.parametrize("kind", ["box", "cylinder"])
def test_a_solid_that_explains_its_views_is_gripped_across_its_narrow_side_too(kind):
    sizes = (0.03, 0.09, 0.05) if kind == "box" else (0.05, 0.05, 0.12)
    turn = Rotation.from_rotvec([0.0, 0.0, 0.4])
    solid = fitted(sizes, center=(0.1, 0.2, 0.3), turn=turn, kind=kind)
    hull = VisualHull.filling(solid)
    np.testing.assert_allclose(np.sort(hull.lengths), np.sort(solid.lengths), atol=0.001)
    grip = hull.grips((0, 0, 1), (0.02, 0.06))[0]
    assert grip.width == pytest.approx(min(sizes), abs=0.005)
    assert grip.hold > 0.8
    if kind == "box":
        assert abs(grip.closing @ turn.as_matrix()[:, 0]) > np.cos(np.radians(10))


def test_silhouettes_of_different_things_leave_no_hull():
    views, _, _, lens = seen("alligator", "flat")
    away = RigidTransform.from_translation([0.0, 0.0, 1.0])
    apart = [replace(view, base_from_camera=pose) for view, pose in zip(views[:3], 3 * [away], strict=True)]
    assert VisualHull.of(apart, lens) is None


def test_too_few_views_and_no_direction_are_refused():
    views, _, _, lens = seen("alligator", "flat")
    with pytest.raises(InvalidParameterError, match="needs 3 views"):
        VisualHull.of(views[:2], lens)
    with pytest.raises(InvalidParameterError, match="vector from the object to the hand"):
        VisualHull.of(views, lens).grips((0, 0, 0))


@pytest.mark.parametrize(("placement", "seed"), [("flat", 1), ("flat", 2), ("ramp", 4)])
def test_what_the_hull_stands_on_is_level_or_slopes_as_the_views_tell(placement, seed):
    cell = WorkCell("floating", "alligator", placement, seed=seed)
    hull = VisualHull.of(SpreadViews(cell.segmenter).plan(cell.arm).views, cell.arm.intrinsics)
    if placement == "flat":
        np.testing.assert_array_equal(hull.above, [0.0, 0.0, 1.0])
        return
    axes = cell.data.xmat[cell.model.body("support_0").id].reshape(3, 3)
    slope = axes[:, np.argmax(axes[2])]
    assert np.degrees(np.arccos(slope[2])) > 35
    assert np.degrees(np.arccos(hull.above @ slope)) < 15
