"""What thesis 2.3 says of the planner, sentence by sentence, and what errata 12 to 15 change in it.

Which stationary point counts, what is said without one, and on which axes a plan ends, is in
``tests/planning/test_image_moments.py``.
"""

import numpy as np
import pytest
from eye_in_hand import CAMERA, PinholeArm, Plate, white
from synthetic import Block

from gvp_book.experiments.alignment import SIZES
from gvp_lib.motion.arc import traverse_arc
from gvp_lib.motion.arm import Outcome
from gvp_lib.motion.sighting import Eye, align_with_major_axis, center_on_object
from gvp_lib.planning.image_moments import ImageMomentPlanner, QuarticFit
from gvp_lib.planning.solids import CYLINDER

TARGETS = ["cuboid_1x1", "cuboid_1x2", "cuboid_1x4", "cylinder"]


@pytest.fixture(scope="module")
def arcs():
    """Arcs of 65 deg to each side from straight above, aligned with the object, by object and axis."""
    seen = {}
    for target in TARGETS:
        length, width, height = SIZES[target]
        block = Block((length, width, height), CYLINDER) if target == "cylinder" else Block((width, length, height))
        for axis in ("y", "x"):
            eye = Eye(PinholeArm(block), white)
            center_on_object(eye)
            align_with_major_axis(eye)
            seen[target, axis] = traverse_arc(eye, axis, max_angle=np.radians(65), step=0.01)
    return seen


# 2.3, Viewpoint Optimizer


def test_the_feature_is_the_ratio_of_the_minor_to_the_major_axis(arcs):
    # Erratum 13: l / w in Algorithm 3, which is the other way around.
    for arc in arcs.values():
        minor = np.array([view.blob.axis_minor_length for view in arc.views])
        major = np.array([view.blob.axis_major_length for view in arc.views])
        np.testing.assert_allclose(arc.ratios, minor / major, rtol=1e-12)
        assert (arc.ratios <= 1).all()


def test_a_4th_order_polynomial_is_fitted_to_the_ratios_over_the_sample_number(arcs):
    arc = arcs["cuboid_1x2", "y"]
    quartic = QuarticFit().fit(arc)
    assert quartic.polynomial.degree() == 4
    np.testing.assert_array_equal(quartic.x, np.arange(len(arc)))
    expected = np.polynomial.polynomial.polyfit(np.arange(len(arc)), arc.ratios, 4)
    np.testing.assert_allclose(quartic.polynomial.convert().coef, expected, rtol=1e-6)


@pytest.mark.parametrize("axis", ["y", "x"])
@pytest.mark.parametrize("target", TARGETS)
def test_for_cuboids_and_cylinders_there_is_a_single_one_or_three_the_middle_of_which_is_optimal(target, axis, arcs):
    arc = arcs[target, axis]
    quartic = QuarticFit().fit(arc)
    found = np.degrees(np.interp(quartic.stationary, quartic.x, arc.angles))
    assert len(found) in (1, 3)
    assert abs(found[len(found) // 2]) < 2  # deg, from an arc about the right view
    assert quartic.chosen == quartic.stationary[len(found) // 2]


def test_long_and_thin_objects_fall_into_the_single_case_and_the_1x1_into_the_case_of_three(arcs):
    # 3.1.6, about Figs. 2.3 and 2.4. Of the arc along the object; across it the 1x2 and 1x4 have three as well.
    assert len(QuarticFit().fit(arcs["cuboid_1x4", "y"]).stationary) == 1
    assert [len(QuarticFit().fit(arcs["cuboid_1x1", axis]).stationary) for axis in "yx"] == [3, 3]


def test_no_quartic_represents_the_1x1_which_has_five_stationary_points(arcs):
    arc = arcs["cuboid_1x1", "y"]
    smooth = np.convolve(arc.ratios, np.ones(7) / 7, "valid")
    assert len(np.flatnonzero(np.diff(np.sign(np.diff(smooth))))) == 5
    left = QuarticFit().fit(arc).polynomial(np.arange(len(arc))) - arc.ratios
    assert np.abs(left).max() > 0.02  # of a range of 0.12


# 2.3, Overall Alignment Procedure, and Algorithm 3


def test_it_performs_traversal_then_optimization_for_both_axes_each_of_its_own_ratios(plan_of):
    # Erratum 12: the arc about the minor axis is along y, and comes first. Erratum 13: as printed the second fit
    # repeats R_major, and would choose the first arc's point again.
    plan = plan_of(QuarticFit())
    assert plan.outcome is Outcome.ALIGNED
    assert [arc.axis for arc in plan.arcs] == ["y", "x"]
    own = [QuarticFit().estimate([arc], CAMERA).joints for arc in plan.arcs]
    np.testing.assert_array_equal([optimum.joints for optimum in plan.optima], own)
    assert np.abs(own[1] - own[0]).max() > 0.01
    # After the first the arm moves to the joint angles of the chosen point and goes on from there.
    first, second = plan.arcs
    assert any(np.array_equal(own[0], view.joints) for view in first.views)
    began = second.views[second.center]
    np.testing.assert_allclose(began.base_from_camera.translation, own[0][:3], atol=1e-9)


def test_an_error_of_the_first_traversal_is_propagated_to_the_final_orientation():
    # 3.1.6. The second arc turns about the other axis, so that it leaves what the first did wrong.
    class Off(QuarticFit):
        """Ends the first arc three views from where it should."""

        def estimate(self, arcs, intrinsics):
            found = super().estimate(arcs, intrinsics)
            return found if len(arcs) == 2 else found.at(arcs[-1], round(found.quartic.index) + 3)

    tilts = []
    for estimator in (QuarticFit(), Off()):
        arm = PinholeArm(Plate(sides=(0.08, 0.03), yaw=0.7), radius=0.32, tilt=0.35, azimuth=2.0)
        ImageMomentPlanner(white, estimator).plan(arm)
        tilts.append(np.degrees(np.arccos(-arm.camera_pose().rotation.as_matrix()[2, 2])))
    assert tilts[0] < 4
    assert tilts[1] - tilts[0] > 5  # of three steps of 4.6 deg, in a direction of its own
