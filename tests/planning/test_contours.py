"""Boxes and cans by their outlines: hidden parts, cut pictures, damaged masks, and what no solid explains."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from eye_in_hand import white
from scipy.spatial.transform import RigidTransform, Rotation
from synthetic import Block, over_block

from gvp_lib import CameraIntrinsics, ImageMomentPlanner, Noise, SilhouetteFit, SpreadViews, WorkCell
from gvp_lib.errors import InvalidParameterError
from gvp_lib.evaluation import begin
from gvp_lib.motion import Outcome
from gvp_lib.perception import Blob, Outline
from gvp_lib.planning import BOX, CYLINDER, ContourFit, Grip, VisualHull
from gvp_lib.planning.comparison import expand
from gvp_lib.planning.grips import resemble
from gvp_lib.planning.seen import Outlines
from gvp_lib.planning.solid_fit import Model, Solids

LENS = CameraIntrinsics(640, 480, 530, 530, 319.5, 239.5)


@cache
def seen(target, placement, seed, others=()):
    """Views of a plan of the moments' fit, the true normal in the base's frame, and the camera's lens."""
    with WorkCell("floating", target, placement, noise=Noise.thesis(), others=others, touching=True) as cell:
        begin(cell, seed, 0)
        plan = ImageMomentPlanner(cell.segmenter, SilhouetteFit()).plan(cell.arm)
        truth = cell.truth
        turn = cell.arm.camera_pose().rotation * truth.world_from_camera.rotation.inv()
        normal = truth.normal.nearest(-truth.world_from_camera.rotation.as_matrix()[:, 2])
        return [view for arc in plan.arcs for view in arc.views], turn.as_matrix() @ normal, cell.arm.intrinsics


def error(views, normal, lens, count=8, fit=None):
    chosen = views[:: max(1, len(views) // count)]
    solid = (fit or ContourFit()).fit(chosen, lens)
    axes = solid.base_from_solid.rotation.as_matrix().T
    if solid.kind == "cylinder" and abs(axes[2] @ normal) < 0.5:
        return solid, np.degrees(np.arcsin(abs(axes[2] @ normal)))
    return solid, np.degrees(np.arccos(min(1.0, np.abs(axes @ normal).max())))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("target", "placement", "others"),
    [
        ("cuboid_1x2", "tilted", ()),
        ("cylinder", "tilted", ()),
        ("cuboid_1x2", "walled", ()),
        ("cuboid_1x1", "walled", ()),
        ("cuboid_1x2", "flat", ("cuboid_1x3", "cuboid_1x1", "cuboid_1x4")),
    ],
)
def test_eight_views_tell_the_normal_also_of_what_is_hidden_in_part(target, placement, others, seed):
    solid, off = error(*seen(target, placement, seed, others))
    assert solid.explains
    assert off < 1.5


def changed(view, lens, change):
    """The view as it were with another mask, in a picture as wide as the lens says."""
    mask = change(view.blob.mask((480, 640)))[:, : lens.width]
    blob = Blob.from_mask(np.ascontiguousarray(mask))
    outline = replace(Outline.of(blob, mask.shape), colors=view.outline.colors)
    return replace(view, blob=blob, clipped=blob.touches_border(mask.shape), outline=outline)


def morphed(operation, size):
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    return lambda mask: operation(mask.astype(np.uint8), kernel) > 0


def ragged(mask):
    noise = cv2.GaussianBlur(np.random.default_rng(0).normal(size=mask.shape), (0, 0), 2)
    distance = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5)
    distance -= cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)
    return distance > 2 * noise / noise.std() * 0.5


def with_holes(mask):
    v, u = np.nonzero(mask)
    for k in np.random.default_rng(0).integers(len(u), size=12):
        mask = mask & (cv2.circle(np.zeros(mask.shape, np.uint8), (int(u[k]), int(v[k])), 5, 1, -1) == 0)
    return mask


DAMAGE = {"eroded": morphed(cv2.erode, 5), "dilated": morphed(cv2.dilate, 5), "ragged": ragged, "holes": with_holes}


@pytest.mark.parametrize("change", DAMAGE.values(), ids=DAMAGE)
def test_damaged_masks_do_little(change):
    views, normal, lens = seen("cuboid_1x2", "tilted", 0)
    solid, off = error([changed(view, lens, change) for view in views], normal, lens, count=12)
    assert solid.explains
    assert off < 1.2


def test_views_that_are_all_cut_by_the_border_serve():
    views, normal, lens = seen("cuboid_1x2", "tilted", 1)
    narrow = CameraIntrinsics(335, lens.height, lens.fx, lens.fy, lens.cx, lens.cy)
    cut = [changed(view, narrow, lambda mask: mask) for view in views]
    assert all(view.clipped for view in cut)
    with pytest.raises(InvalidParameterError, match="clipped by the border"):
        SilhouetteFit().fit(cut, narrow)
    solid, off = error(cut, normal, narrow, count=12)
    assert solid.explains
    assert off < 1.5


def test_what_no_solid_explains_says_so_and_its_hull_takes_the_place_within_an_honest_region():
    views, normal, lens = seen("alligator", "flat", 0)
    solid = ContourFit().fit(views[::4], lens)
    assert not solid.explains
    assert solid.residual > 3
    assert np.arccos(np.abs(solid.base_from_solid.rotation.as_matrix().T @ normal).max()) < solid.within(0.9)
    assert 2 < np.degrees(solid.uncertainty) < 15
    bare = [replace(view, blob=replace(view.blob, pixels=None)) for view in views[::4]]
    assert not ContourFit().fit(bare, lens).explains  # of moments alone there is no hull
    with WorkCell("floating", "alligator", seed=2) as cell:
        plan = SpreadViews(cell.segmenter).plan(cell.arm)
        assert (plan.outcome, plan.grips) == (Outcome.UNEXPLAINED, ())
        assert cell.truth.viewpoint_error() < 2 * plan.uncertainty
        plan = SpreadViews(cell.segmenter, ContourFit(opening=(0.028, 0.060))).plan(cell.arm)
        assert 0.028 < plan.grips[0].width < 0.072
        along = plan.view.base_from_camera.rotation.as_matrix()[:, 0] @ plan.grips[0].closing
        assert abs(along) > np.cos(np.radians(0.5))  # the camera's x is the axis along which the fingers close
        # Wider ones close in the middle of so slender a thing, across its length, from as far above as can be.
        plan = SpreadViews(cell.segmenter, ContourFit(opening=(0.028, 0.072))).plan(cell.arm)
        assert (plan.outcome, plan.grips) == (Outcome.UNEXPLAINED, ())
        longest = plan.solid.base_from_solid.rotation.as_matrix()[:, np.argmax(plan.solid.lengths)]
        x, _, z = plan.view.base_from_camera.rotation.as_matrix().T
        assert abs(x @ longest) < np.sin(np.radians(1))
        assert -z[2] > np.sqrt(1 - longest[2] ** 2) - 0.01


@pytest.mark.parametrize("target", ["alligator", "cuboid_1x2"])
def test_a_grip_that_held_nothing_is_not_tried_again_whether_or_not_a_solid_explains_the_views(target):
    with WorkCell("floating", target, seed=2) as cell:
        plan = SpreadViews(cell.segmenter).plan(cell.arm)
        lens, first = cell.arm.intrinsics, plan.arcs[0].views[plan.arcs[0].center]
    opening = (0.01, 0.065)
    fit = ContourFit(opening=opening)
    usual = fit.estimate(plan.arcs, lens).grips or VisualHull.of(plan.views, lens).grips(-first.line_of_sight, opening)
    other = replace(fit, failed=usual[:1]).estimate(plan.arcs, lens).grips
    assert not resemble(usual[0], other[0])


@pytest.mark.parametrize(
    ("turned", "moved", "alike"),
    [((0, 0, 0), 0, True), ((0, 0, 20), 0.02, True), ((0, 0, 180), 0, True), ((0, 0, 40), 0, False),
     ((0, 40, 0), 0, False), ((0, 0, 0), 0.04, False)],
)  # fmt: skip
def test_grips_resemble_each_other_where_fingers_close_alike_and_in_one_place(turned, moved, alike):
    one = Grip(np.zeros(3), np.array([0.0, 0, 1]), np.array([1.0, 0, 0]), 0.03, 0.02, 1.0)
    look, closing = Rotation.from_euler("xyz", turned, degrees=True).apply([one.look, one.closing])
    other = replace(one, center=np.array([moved, 0, 0]), look=look, closing=closing)
    assert resemble(one, other) is resemble(other, one) is alike


@pytest.mark.parametrize(
    ("widest", "leaning", "facing"), [(0.070, -32, 2), (0.050, -32, 1), (0.010, -32, 2), (0.050, 0, 2)]
)
def test_of_a_solid_that_explains_the_views_the_nearest_face_from_above_is_taken_that_fingers_can_span(
    widest, leaning, facing
):
    turn = Rotation.from_rotvec([np.radians(leaning), 0.0, 0.0])
    block = Block((0.090, 0.060, 0.040), rotation=turn, center=(0.0, 0.0, -0.020))
    plan = SpreadViews(white, ContourFit(opening=(0.001, widest))).plan(over_block(block, tilt=0.4, azimuth=1.2))
    assert plan.solid.explains
    lengths, axes = plan.solid.lengths, plan.solid.base_from_solid.rotation.as_matrix()
    faces = np.argsort(-lengths)  # longest, middle, shortest
    assert int(np.argmax(np.abs(axes.T @ plan.solid.normal))) == faces[facing]


def test_views_without_outlines_are_refused():
    views, _, lens = seen("cuboid_1x2", "tilted", 0)
    with pytest.raises(InvalidParameterError, match=r"ContourFit.fit needs 5 views.*got 6, of which 6 are"):
        ContourFit().fit([replace(view, outline=None) for view in views[:6]], lens)
    with pytest.raises(InvalidParameterError, match="point_sd"):
        ContourFit(point_sd=0)


@pytest.mark.parametrize("model", [Model(BOX, False), Model(BOX, True), Model(CYLINDER, True)], ids=str)
def test_derivatives_are_those_of_the_residuals(model):
    sizes = np.log([0.06, 0.03, 0.02][: 2 if model.shape.round else 3] + [0.004, 0.006] * model.top)
    turns = Rotation.from_rotvec([[0.3, 0.2, 0.5], [-0.1, 0.4, 0.2]])
    solids = Solids(turns.as_matrix(), np.array([[0.003, 0.001, 0.002], [0, 0, 0]]), np.stack([sizes, sizes]))
    around = np.linspace(0, 2 * np.pi, 30, endpoint=False)
    points = LENS.principal_point + np.column_stack([90 * np.cos(around), 70 * np.sin(around)])
    eyes = [Rotation.from_rotvec([2.8, 0.1 * k, 0.3 * k]) for k in range(4)]
    rotation = np.array([eye.as_matrix() for eye in eyes])
    flags = np.ones((4, 30), bool)
    position = -0.25 * rotation[:, :, 2]
    outlines = Outlines(np.stack([points] * 4), flags, ~flags, rotation, position, LENS, 0.5, np.ones(6))
    _, to_solid, to_view = expand(model, solids, outlines)

    def moved(step):
        poses = RigidTransform.from_components(outlines.position, Rotation.from_matrix(rotation))
        poses = poses * RigidTransform.from_components(step[3:], Rotation.from_rotvec(step[:3]))
        return replace(outlines, rotation=poses.rotation.as_matrix(), position=poses.translation)

    for k, step in enumerate(1e-6 * np.eye(to_solid.shape[-1])):
        pair = [expand(model, solids.moved(np.stack([sign * step] * 2)), outlines)[0] for sign in (1, -1)]
        np.testing.assert_allclose((pair[0] - pair[1]) / 2e-6, to_solid[..., k], rtol=1e-4, atol=1e-2)
    for k, step in enumerate(1e-6 * np.eye(6)):
        pair = [expand(model, solids, moved(sign * step))[0] for sign in (1, -1)]
        np.testing.assert_allclose((pair[0] - pair[1]) / 2e-6, to_view[..., k], rtol=1e-4, atol=1e-2)


@pytest.mark.parametrize(("target", "placement"), [("cuboid_1x2", "walled"), ("cylinder", "tilted")])
def test_a_fit_that_begins_at_a_solid_ends_where_one_does_that_begins_anew(target, placement):
    views, _, lens = seen(target, placement, 0)
    chosen = views[:: len(views) // 8]
    anew = ContourFit().fit(chosen, lens)
    before = ContourFit().fit(chosen[:-2], lens)
    explains_nothing = replace(before, residual=9.0)
    for start in (before, explains_nothing):
        warm = ContourFit().fit(chosen, lens, start=start)
        assert warm.kind == anew.kind
        assert warm.explains
        np.testing.assert_allclose(sorted(warm.lengths), sorted(anew.lengths), atol=0.0005)
        assert abs(warm.normal @ anew.normal) > np.cos(np.radians(0.1))


def test_a_hand_that_opens_by_a_centimeter_finds_no_place_on_an_alligator():
    with WorkCell("floating", "alligator", seed=2) as cell:
        plan = SpreadViews(cell.segmenter, ContourFit(opening=(0.001, 0.010))).plan(cell.arm)
    assert (plan.outcome, plan.grips) == (Outcome.UNEXPLAINED, ())
