"""Our estimator on views made of exact silhouettes: what it finds, how well, and how well it knows that."""

from dataclasses import replace

import numpy as np
import pytest
from eye_in_hand import CAMERA
from scipy.spatial.transform import RigidTransform, Rotation
from synthetic import arcs_of_solid, cross_of_viewpoints

from gvp_book.experiments.alignment import SIZES
from gvp_lib.errors import InvalidParameterError
from gvp_lib.motion.arc import Arc
from gvp_lib.motion.sighting import Eye
from gvp_lib.planning.least_squares import Model, Observations, refine
from gvp_lib.planning.plan import Finding
from gvp_lib.planning.silhouette import SilhouetteFit, first_guesses
from gvp_lib.planning.solids import BOX, CYLINDER
from gvp_lib.simulation.workcell import WorkCell

pytestmark = pytest.mark.check

PRIOR = np.repeat([SilhouetteFit().rotation_sd, SilhouetteFit().translation_sd], 3)  # rad and m
CENTER = np.array([0.02, 0.01, 0.05])
PLAIN = (0.064, 0.032, 0.020, 0.0, 0.0)
STUDDED = {n: (0.032 * n, 0.032, 0.019, 0.004, 0.005) for n in (1, 2, 4)}
CAN = (0.060, 0.060, 0.140, 0.008, 0.010)
STANDING, LYING = Rotation.identity(), Rotation.from_rotvec([np.pi / 2, 0, 0])


class Case:
    """A solid, and two arcs over it that began 20 deg from the right view."""

    def __init__(self, shape, sizes, seed=0, up=STANDING, noisy=False, **cross):
        rng = np.random.default_rng(seed)
        self.solid = RigidTransform.from_components(CENTER, Rotation.from_rotvec([0, 0, rng.uniform(0, 6)]) * up)
        cross = {"tilt": np.radians(20), "azimuth": rng.uniform(0, 6), "n": 9, **cross}
        viewpoints = cross_of_viewpoints(CENTER, **cross)
        n = sum(map(len, viewpoints))
        self.errors = rng.normal(size=(n, 6)) * PRIOR if noisy else np.zeros((n, 6))
        noise = rng.normal(size=(n, 4)) * SilhouetteFit().moment_sd if noisy else None
        self.arcs = arcs_of_solid(shape, self.solid, sizes, viewpoints, self.errors, noise)
        self.axis = self.solid.rotation.apply([0.0, 0.0, 1.0])

    def fit(self, arcs=None, **options):
        found = SilhouetteFit(**options).estimate(self.arcs if arcs is None else arcs, CAMERA)
        assert found.finding is Finding.OPTIMUM
        assert found.uncertainty == found.detail.uncertainty
        return found.detail

    def error(self, solid, lying=False):
        """Of the normal, deg; a lying can's may be any across its axis."""
        across = self.axis @ solid.normal
        return np.degrees(abs(np.arcsin(across)) if lying else np.arccos(np.clip(across, -1, 1)))


# What it finds


@pytest.mark.parametrize("n", [1, 2, 4])
def test_of_a_clean_brick_it_finds_the_face_the_sizes_and_the_studs(n):
    case = Case(BOX, STUDDED[n], seed=n)
    solid = case.fit()
    assert solid.kind == "box"
    assert case.error(solid) < 0.05
    np.testing.assert_allclose(np.sort(solid.sizes), np.sort(STUDDED[n][:3]), atol=0.0005)
    np.testing.assert_allclose(solid.top, STUDDED[n][3:], atol=0.0005)
    assert solid.base_from_solid.rotation.apply([0, 0, 1]) @ case.axis > 0.9999  # the studs are on top
    np.testing.assert_allclose(solid.base_from_solid.translation, CENTER + 0.5 * solid.top[1] * case.axis, atol=0.0005)
    assert solid.residual < 0.01


@pytest.mark.parametrize(("up", "lying"), [(STANDING, False), (LYING, True)], ids=["standing", "lying"])
def test_of_a_clean_can_it_finds_the_axis_the_sizes_and_the_shoulder(up, lying):
    case = Case(CYLINDER, CAN, seed=1, up=up)
    solid = case.fit()
    assert solid.kind == "cylinder"
    assert case.error(solid, lying) < 0.1
    assert abs(solid.base_from_solid.rotation.apply([0, 0, 1]) @ case.axis) > np.cos(np.radians(0.1))
    np.testing.assert_allclose(solid.sizes + (0, 0, solid.top[1]), (0.060, 0.060, 0.150), atol=0.002)


@pytest.mark.parametrize("shape", [BOX, CYLINDER], ids=lambda shape: shape.name)
def test_a_solid_without_a_top_is_found_to_have_none(shape):
    # A top would explain it as well; it is the price on two more sizes that decides.
    solid = Case(shape, PLAIN if shape is BOX else (0.06, 0.06, 0.15, 0, 0), seed=2).fit()
    assert solid.top == (0, 0)
    assert solid.kind == shape.name


def test_box_or_can_is_told_by_what_explains_the_views_better():
    for shape, sizes in ((BOX, STUDDED[2]), (CYLINDER, CAN)):
        case = Case(shape, sizes, seed=3, noisy=True)
        residuals = {only: case.fit(shapes=(only,)).residual for only in ("box", "cylinder")}
        assert min(residuals, key=residuals.get) == case.fit().kind == shape.name


@pytest.mark.parametrize("first", [0, 8], ids=["one end", "the other"])
def test_the_face_is_the_one_nearest_to_where_the_first_arc_began(first):
    # The same views; only which of them was the first differs. From the ends of 70 deg another face is nearer.
    case = Case(BOX, (0.05, 0.045, 0.04, 0, 0), tilt=0.0, spread=np.radians(70))
    arcs = [replace(case.arcs[0], center=first), case.arcs[1]]
    solid = SilhouetteFit().estimate(arcs, CAMERA).detail
    from_there = arcs[0].views[first].base_from_camera.translation - CENTER
    assert case.error(case.fit()) < 0.1
    assert case.error(solid) == pytest.approx(90, abs=0.1)
    assert solid.normal @ from_there / 0.25 > np.cos(np.radians(50))


def test_the_poses_look_along_the_normal_from_the_radius_with_y_on_the_major_axis_nearest_roll_first():
    case = Case(BOX, STUDDED[2], seed=4)
    poses = SilhouetteFit(radius=0.3).estimate(case.arcs, CAMERA).poses
    major = case.solid.rotation.apply([1.0, 0.0, 0.0])
    here = case.arcs[0].views[4].base_from_camera.rotation
    for pose in poses:
        x, y, z = pose.rotation.as_matrix().T
        assert -z @ case.axis > np.cos(np.radians(0.1))
        assert abs(y @ major) > np.cos(np.radians(0.1))
        np.testing.assert_allclose(np.cross(x, y), z, atol=1e-9)
    reach = [np.linalg.norm(pose.translation - CENTER) for pose in poses]
    np.testing.assert_allclose(reach, np.repeat([0.3, 0.36, 0.255], 2), atol=0.004)
    rolls = [(here.inv() * pose.rotation).magnitude() for pose in poses[:2]]
    assert rolls[0] < rolls[1]


@pytest.mark.parametrize(
    ("shape", "sizes", "up", "rolls"),
    [
        (BOX, STUDDED[1], STANDING, 4),
        (BOX, STUDDED[2], STANDING, 2),
        (CYLINDER, CAN, STANDING, 8),
        (CYLINDER, CAN, LYING, 2),
    ],
    ids=["square", "oblong", "standing can", "lying can"],
)
def test_as_many_rolls_are_offered_as_are_equally_good(shape, sizes, up, rolls):
    assert len(SilhouetteFit().estimate(Case(shape, sizes, seed=1, up=up).arcs, CAMERA).poses) == 3 * rolls


def test_what_all_views_share_of_the_arms_error_moves_the_solid_along_and_does_no_harm():
    # A base that is elsewhere than the arm thinks: 20 mm and 3 deg, ten times what is allowed for.
    case = Case(BOX, STUDDED[2], seed=2)
    elsewhere = RigidTransform.from_components([0.02, -0.01, 0.015], Rotation.from_rotvec([0.05, -0.02, 0.01]))
    arcs = [
        replace(arc, views=tuple(replace(v, base_from_camera=elsewhere * v.base_from_camera) for v in arc.views))
        for arc in case.arcs
    ]
    solid = case.fit(arcs)
    assert np.degrees(np.arccos(solid.normal @ elsewhere.rotation.apply(case.axis))) < 0.05
    assert solid.residual < 0.01


# The arm's own error


@pytest.mark.parametrize(
    ("shape", "sizes", "up"),
    [*((BOX, STUDDED[n], STANDING) for n in (1, 2, 4)), (CYLINDER, CAN, STANDING), (CYLINDER, CAN, LYING)],
    ids=["1x1", "1x2", "1x4", "standing can", "lying can"],
)
def test_errors_of_the_views_poses_and_pixels_cost_less_than_a_degree_and_are_found(shape, sizes, up):
    case = Case(shape, sizes, seed=5, up=up, noisy=True, n=15)
    solid = case.fit()
    assert solid.kind == shape.name
    assert case.error(solid, lying=up is LYING) < 1
    total = np.sort(solid.sizes + (0, 0, solid.top[1]))
    np.testing.assert_allclose(total, np.sort(np.array(sizes[:3]) + (0, 0, sizes[4])), atol=0.003)
    assert solid.residual < 0.2
    # Each view is found to have stood where it did: sideways turns and shifts look alike, so they come out together.
    found = solid.corrections
    assert found.shape == case.errors.shape
    for k in (3, 4, 5):
        assert np.corrcoef(found[:, k], case.errors[:, k])[0, 1] > 0.6
    sideways = np.stack([case.errors[:, 4] - 0.25 * case.errors[:, 0], found[:, 4] - 0.25 * found[:, 0]])
    assert np.corrcoef(sideways)[0, 1] > 0.9


def test_without_an_allowance_for_the_arms_error_the_fit_is_worse():
    # What the allowance is for: eight cases, fitted as if the arm knew where it stood.
    allowed, trusted = (
        np.mean([case.error(case.fit(shapes=("box",), **options)) for case in cases])
        for cases in [[Case(BOX, STUDDED[2], seed=s, noisy=True) for s in range(20, 24)]]
        for options in ({}, {"rotation_sd": 1e-6, "translation_sd": 1e-6})
    )
    assert allowed < 0.8 * trusted
    assert allowed < 0.7


def test_one_wild_view_is_all_but_ignored():
    case = Case(BOX, STUDDED[2], seed=6, noisy=True)
    before = case.fit(shapes=("box",))
    views = list(case.arcs[0].views)
    blob = views[2].blob
    views[2] = replace(views[2], blob=replace(blob, area=2 * blob.area, mu20=3 * blob.mu20))
    after = case.fit([replace(case.arcs[0], views=tuple(views)), case.arcs[1]], shapes=("box",))
    assert np.degrees(np.arccos(before.normal @ after.normal)) < 0.5
    assert case.error(after) < 1


# How well it knows that


@pytest.mark.full
def test_the_error_is_within_three_standard_deviations_in_nearly_all_of_twenty_cases():
    cases = [Case(BOX, STUDDED[(1, 2, 4)[s % 3]], seed=100 + s, noisy=True, n=7) for s in range(20)]
    solids = [case.fit(shapes=("box",)) for case in cases]
    sigmas = np.array([np.radians(case.error(solid)) / solid.uncertainty for case, solid in zip(cases, solids)])  # noqa: B905
    assert (sigmas < 3).sum() >= 18
    assert np.sqrt(np.mean(sigmas**2)) > 0.1  # and it is not merely cautious


def test_fewer_views_and_a_single_arc_leave_more_doubt():
    case = Case(BOX, STUDDED[2], seed=7, noisy=True)
    arc = case.arcs[0]
    few = replace(arc, views=arc.views[2:7], center=2)
    doubts = [case.fit(arcs).uncertainty for arcs in (case.arcs, [arc], [few])]
    assert doubts[0] < doubts[1] < doubts[2]
    assert doubts[0] < np.radians(1.5)


def test_solids_that_explain_the_views_as_well_and_look_elsewhere_are_part_of_the_doubt():
    # From five views within 10 deg of each other hardly anything can be told, and that is what it says.
    case = Case(BOX, STUDDED[1], seed=8, noisy=True, spread=np.radians(10), n=5)
    assert case.fit(case.arcs[:1]).uncertainty > np.radians(8)


# Which views count


def test_clipped_views_are_left_out():
    case = Case(BOX, STUDDED[2], seed=9)
    wild = [replace(v, clipped=True, blob=replace(v.blob, area=9, mu20=1.0)) for v in case.arcs[0].views[:3]]
    with_wild = [replace(case.arcs[0], views=(*wild, *case.arcs[0].views[3:])), case.arcs[1]]
    without = [replace(case.arcs[0], views=case.arcs[0].views[3:], center=1), case.arcs[1]]
    a, b = case.fit(with_wild), case.fit(without)
    np.testing.assert_array_equal(a.normal, b.normal)
    assert len(a.corrections) == 15


@pytest.mark.parametrize("clipped", [0, 2])
def test_fewer_than_five_whole_views_are_too_few_and_the_camera_goes_to_the_center(clipped):
    arc = Case(BOX, PLAIN).arcs[0]
    views = [replace(view, clipped=k < clipped) for k, view in enumerate(arc.views[: 4 + clipped])]
    optimum = SilhouetteFit().estimate([Arc("y", tuple(views), 3, arc.ends, arc.ranges)], CAMERA)
    assert optimum.finding is Finding.TOO_FEW_VIEWS
    np.testing.assert_array_equal(optimum.joints, views[3].joints)
    assert optimum.poses == ()
    assert np.isnan(optimum.uncertainty)


def test_views_of_an_earlier_arc_count_too():
    arcs = Case(BOX, PLAIN).arcs
    halves = [replace(arc, views=arc.views[3:6], center=1) for arc in arcs]
    assert SilhouetteFit().estimate(halves, CAMERA).finding is Finding.OPTIMUM
    assert SilhouetteFit().estimate(halves[:1], CAMERA).finding is Finding.TOO_FEW_VIEWS


# The search


@pytest.mark.parametrize("inset", [0.004, 0.05], ids=["small inset", "one wider than the solid"])
@pytest.mark.parametrize("shape", [BOX, CYLINDER], ids=lambda shape: shape.name)
def test_the_growth_of_a_model_is_the_slope_of_its_sizes(shape, inset):
    body = [0.06, 0.04, 0.02] if shape is BOX else [0.05, 0.1]
    for model, free in ((Model(shape, top=False), body), (Model(shape, top=True), [*body, inset, 0.005])):
        logs, steps = np.log(free), 1e-6 * np.eye(len(free))
        slopes = (model.sizes(logs + steps) - model.sizes(logs - steps)) / 2e-6
        np.testing.assert_allclose(model.growth(logs), slopes.T, atol=1e-9)


@pytest.mark.full
def test_a_single_start_often_ends_in_a_wrong_valley_and_all_together_do_not():
    # One arc of 30 deg to each side over clean bricks.
    model, together, alone = Model(BOX, top=False), [], []

    def error(starts):
        best = min(refine(model, starts, seen), key=lambda solution: solution.criterion)
        across = np.abs(case.axis @ best.solid.rotation[0]).max()  # of the box's axis nearest the face's normal
        return np.degrees(np.arccos(min(1.0, across)))

    for seed in range(6):
        sizes = (0.032 * (2, 4, 1)[seed % 3], 0.032, 0.019, 0, 0)
        case = Case(BOX, sizes, seed=seed, tilt=np.radians(30), spread=np.radians(30))
        seen = Observations.of(case.arcs[0].views, CAMERA, 0.25, PRIOR)
        starts = first_guesses(model, seen)
        together.append(error(starts))
        alone += [error(starts[[k]]) for k in range(len(starts))]
    assert max(together) < 0.01
    assert np.mean(np.array(alone) > 5) > 0.3


def test_the_same_views_give_the_same_solid_to_the_bit():
    case = Case(BOX, STUDDED[2], seed=10, noisy=True, n=5)
    a, b = case.fit(), case.fit()
    for name in ("normal", "sizes", "corrections", "uncertainty", "residual"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


# A picture in place of the exact silhouette


@pytest.mark.parametrize(
    ("target", "sizes", "within"),
    [("cuboid_1x2", SIZES["cuboid_1x2"], 0.001), ("cylinder", SIZES["cylinder"], 0.003)],
)
def test_from_pictures_it_finds_the_face_and_the_sizes(target, sizes, within):
    with WorkCell(arm="floating", target=target, seed=3) as cell:
        center = cell.truth.world_from_object.translation
        arcs, eye = [], Eye(cell.arm, cell.segmenter)
        for axis, poses in zip(("y", "x"), cross_of_viewpoints(center, np.radians(15), 1.0), strict=True):
            views = []
            for pose in poses:
                cell.place_camera(pose)
                eye.expect(None)
                views.append(eye.look())
            arcs.append(Arc(axis, tuple(views), 4, (None, None), np.full(9, np.nan)))
        solid = SilhouetteFit().estimate(arcs, cell.arm.intrinsics).detail
        assert solid.normal @ cell.truth.normal.direction > np.cos(np.radians(0.7))
        lengths = solid.sizes + ((0, 0, solid.top[1]) if target == "cylinder" else (0, 0, 0))
        np.testing.assert_allclose(np.sort(lengths), np.sort(sizes), atol=within)


# Misuse


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"radius": 0.0}, r"SilhouetteFit\.radius is positive; got 0\.0"),
        ({"moment_sd": -1.0}, r"SilhouetteFit\.moment_sd is positive; got -1\.0"),
        ({"rotation_sd": np.nan}, r"SilhouetteFit\.rotation_sd is positive; got nan"),
        ({"translation_sd": np.inf}, r"SilhouetteFit\.translation_sd is positive; got inf"),
        ({"shapes": ()}, r'shapes are of "box" and "cylinder", at least one; got \(\)'),
        ({"shapes": ("box", "ball")}, r"at least one; got \('box', 'ball'\)"),
    ],
)
def test_settings_that_make_no_sense_are_refused(options, text):
    with pytest.raises(InvalidParameterError, match=text):
        SilhouetteFit(**options)
