"""A laboratory that was mailed, in a browser: it opens from a file, asks no network, and does what its buttons say."""

import gzip

import numpy as np
import pytest
from reader import AXE, OF_COLOR, SERIOUS, WIDE, Watched

from gvp_lib.motion.arc import approach
from gvp_lib.motion.sighting import Eye, center_on_object
from gvp_lib.simulation.workcell import WorkCell
from gvp_lib.views.lab import Lab

pytestmark = pytest.mark.full
READY = "['ready', 'failed'].includes(document.documentElement.dataset.lab)"
LOOK = """async (joints) => {
  const { cell, eye } = lab;
  await lab.run(async () => { await cell.moveJoints(joints); eye.expect(null); await eye.look(); });
  const { tracker: { last: { area, centroid, ratio } } } = eye;
  return { area, centroid, ratio };
}"""


@pytest.fixture(scope="module", params=["baxter", "ur5e"])
def cell(request):
    with WorkCell(request.param, "cuboid_1x2", seed=7) as made:
        yield made


@pytest.fixture(scope="module")
def laboratory(browser, cell, tmp_path_factory):
    saved = Lab(cell, title="A brick").save(tmp_path_factory.mktemp("mailed") / "lab.html")
    with Watched(browser, viewport=WIDE, reduced_motion="reduce") as watched:
        watched.open(saved)
        watched.page.wait_for_function(READY)
        yield watched


def test_it_gets_ready_and_keeps_no_reader_out(laboratory):
    page = laboratory.page
    assert page.locator("#status").inner_text() == "Ready", page.locator("#message").inner_text()
    page.evaluate(AXE)
    assert page.evaluate(SERIOUS, {"only": None, "without": OF_COLOR}) == []
    assert laboratory.wrong == []


def test_the_hands_picture_is_mujocos_from_wherever_it_looks(laboratory, cell):
    """Its mask by the ellipse: as large, in the same place, of the same ratio."""
    eye, compared = Eye(cell.arm, cell.segmenter), 0
    start = cell.arm.joints
    for shift in np.random.default_rng(0).uniform(-0.15, 0.15, (9, len(start))):
        cell.arm.move_joints(start + 0.4 * shift)
        eye.expect(None)
        view = eye.look()
        if view is None or view.clipped:
            continue
        there = laboratory.page.evaluate(LOOK, cell.arm.joints.tolist())
        assert there["ratio"] == pytest.approx(view.blob.ratio, abs=0.003)
        assert there["area"] == pytest.approx(view.blob.area, rel=0.01)
        np.testing.assert_allclose(there["centroid"], view.blob.centroid, atol=0.5)
        compared += 1
    cell.arm.move_joints(start)
    assert compared >= 6


def test_from_the_same_start_it_centers_and_comes_as_near_as_the_library(laboratory, cell):
    page, eye, start = laboratory.page, Eye(cell.arm, cell.segmenter), cell.arm.joints
    assert center_on_object(eye)
    assert approach(eye, 0.25)
    page.get_by_role("button", name="Reset").click()
    page.wait_for_function("document.getElementById('status').textContent === 'Ready'")
    pose = page.evaluate("lab.cell.cameraPose()")
    np.testing.assert_allclose(pose["p"], cell.arm.camera_pose().translation, atol=0.005)
    turned = np.reshape(pose["R"], (3, 3)).T @ cell.arm.camera_pose().rotation.as_matrix()
    assert np.degrees(np.arccos(np.clip((np.trace(turned) - 1) / 2, -1, 1))) < 0.5
    cell.arm.move_joints(start)


def test_in_the_book_its_still_stands_until_it_is_started(browser, html):
    with Watched(browser, viewport=WIDE, reduced_motion="reduce", color_scheme="dark") as watched:
        watched.open(html / "notebooks" / "98_of_a_test.html")
        page, place = watched.page, watched.page.locator(".gvp-lab")
        assert place.locator("img").evaluate("(image) => image.naturalWidth") > 400
        assert place.locator("iframe").count() == 0
        place.get_by_role("button", name="Start the laboratory").click()
        frame = place.locator("iframe").element_handle().content_frame()
        frame.wait_for_function(READY)
        assert frame.locator("#status").inner_text() == "Ready"
        frame.locator(":root.dark").wait_for()
        assert page.locator(".gvp-lab button").count() == 0


def test_laboratories_of_the_book_share_their_scripts_and_weigh_little(html):
    labs = [*(html / "_static" / "generated" / "labs").glob("*.html")]
    assert "98_of_a_test-1.html" in [lab.name for lab in labs]
    for lab in labs:
        assert len(gzip.compress(lab.read_bytes())) < 25_000, lab.name  # of which the scene has at most 20 kB
        assert lab.with_suffix(".png").exists()
    assert (html / "_static" / "generated" / "mujoco.js").stat().st_size < 2.2e6
