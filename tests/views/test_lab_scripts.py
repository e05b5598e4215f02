"""The laboratory's scripts against the library: what both compute is the same."""

import numpy as np
import pytest
from eye_in_hand import PinholeArm, white
from page_scripts import node

from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.motion.primitives import turn
from gvp_lib.perception.blobs import Blob, blobs_from_mask
from gvp_lib.perception.segmentation import HsvThreshold
from gvp_lib.planning.image_moments import ImageMomentPlanner, QuarticFit
from gvp_lib.simulation.objects import OBJECTS

pytestmark = pytest.mark.check


def as_script(segmenter):
    ranges = {name: list(getattr(segmenter, name)) for name in ("hue", "saturation", "value")}
    return ranges | {"kernelSize": segmenter.kernel_size}


def pictures(rng, count):
    """Noise, patches, and patches under noise, some a pixel wide."""
    for n in range(count):
        height, width = int(rng.integers(1, 60)), int(rng.integers(1, 80))
        if n % 3 == 0:
            yield rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
            continue
        patches = rng.integers(0, 256, ((height + 6) // 7, (width + 6) // 7, 3), dtype=np.uint8)
        picture = np.repeat(np.repeat(patches, 7, 0), 7, 1)[:height, :width]
        if n % 3 == 2:
            picture = np.clip(picture.astype(int) + rng.integers(-8, 9, picture.shape), 0, 255)
        yield np.ascontiguousarray(picture, np.uint8)


SEGMENTERS = {
    **{name: spec.segmenter for name, spec in OBJECTS.items()},
    "grays, too": HsvThreshold(hue=(300, 60)),
    "everything": HsvThreshold(),
    "not filtered": HsvThreshold(hue=(200, 250), saturation=(0.3, 1), kernel_size=1),
    "a large kernel": HsvThreshold(hue=(300, 150), kernel_size=7),
}


def described(blob):
    if blob is None:
        return None
    plain = {"area": blob.area, "centroid": blob.centroid.tolist(), "bbox": list(blob.bbox)}
    moments = {name: getattr(blob, name) for name in ("mu20", "mu11", "mu02", "ratio", "orientation")}
    return plain | moments | {"major": blob.axis_major_length, "minor": blob.axis_minor_length}


def alike(ours, theirs):
    """To 1e-9; JSON has null for NaN."""
    if theirs is None:
        return ours is None
    for name, value in theirs.items():
        if name == "orientation" and np.isnan(value):
            assert ours[name] is None
        else:
            np.testing.assert_allclose(ours[name], value, rtol=1e-9, atol=1e-9, err_msg=name)
    return True


def test_masks_differ_in_no_pixel_and_blobs_in_the_ninth_digit(tmp_path):
    rng, cases, expected = np.random.default_rng(0), [], []
    for segmenter in SEGMENTERS.values():
        for rgb in pictures(rng, 12):
            mask = segmenter(rgb)
            rgba = np.dstack([rgb, np.full(rgb.shape[:2], 255, np.uint8)])
            height, width = mask.shape
            cases.append(
                {"ranges": as_script(segmenter), "width": width, "height": height, "rgba": rgba.ravel().tolist()}
            )
            expected.append((mask.ravel(), Blob.from_mask(mask), blobs_from_mask(mask, 3)))
    code = """
    const tell = (blob) => {
      if (!blob) return null;
      const { major, minor, ratio, orientation } = blob;
      return { ...blob, major, minor, ratio, orientation };
    };
    console.log(JSON.stringify(given.map(({ ranges, width, height, rgba }) => {
      const mask = new perception.Threshold(ranges, width, height).mask(Uint8Array.from(rgba));
      return [[...mask], tell(perception.blobOf(mask, width, [0, 0, width, height])),
        perception.blobsOf(mask, width, height, 3).map(tell)];
    })));
    """
    found = node(tmp_path, ["perception"], code, cases)
    for (mask, blob, regions), (pixels, whole, parts) in zip(expected, found, strict=True):
        np.testing.assert_array_equal(np.array(pixels, bool), mask)
        assert alike(whole, None if blob is None else described(blob))
        assert [part["area"] for part in parts] == [region.area for region in regions]
        areas = [region.area for region in regions]
        for part, region in zip(parts, regions, strict=True):
            if areas.count(region.area) == 1:  # of several as large either may come first
                assert alike(part, described(region))


# An arm that draws a level plate: a pixel is white where its ray meets the plate. In both languages.


SMALL = CameraIntrinsics(320, 240, 265.0, 265.0, 159.5, 119.5)


class Drawn(PinholeArm):
    def __init__(self, sides, yaw, **where):
        super().__init__(**where)
        self.sides, self.yaw, self.intrinsics = sides, yaw, SMALL

    def capture(self):
        pose, lens = self.camera_pose(), self.intrinsics
        turn = pose.rotation.as_matrix()
        u, v = np.meshgrid(np.arange(lens.width), np.arange(lens.height))
        x, y = (u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy
        ray = [turn[i, 0] * x + turn[i, 1] * y + turn[i, 2] for i in range(3)]
        depth = -pose.translation[2] / ray[2]
        px, py = pose.translation[0] + depth * ray[0], pose.translation[1] + depth * ray[1]
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        inside = (np.abs(c * px + s * py) < self.sides[0] / 2) & (np.abs(c * py - s * px) < self.sides[1] / 2)
        return np.repeat(np.where(inside & (depth > 0), 255, 0).astype(np.uint8)[..., None], 3, axis=2)


DRAWN = """
const lens = { width: 320, height: 240, fx: 265, fy: 265, cx: 159.5, cy: 119.5 };
class Drawn {
  constructor(sides, yaw, start) { Object.assign(this, { sides, yaw, lens, at: start }); }
  get joints() { return [...this.at.p, ...geometry.vector(this.at.R)]; }
  cameraPose() { return this.at; }
  async moveCamera(target) { this.at = geometry.compose(this.at, target); return "reached"; }
  async moveJoints(q) { this.at = geometry.pose(q.slice(0, 3), geometry.rotation(q.slice(3))); return "reached"; }
  rotateWrist(angle) { return this.moveCamera(geometry.turn([0, 0, angle])); }
  async capture() {
    const { p, R } = this.at, rgba = new Uint8Array(4 * 320 * 240), [c, s] = [Math.cos(this.yaw), Math.sin(this.yaw)];
    for (let v = 0, k = 0; v < 240; v++) for (let u = 0; u < 320; u++, k += 4) {
      const x = (u - lens.cx) / lens.fx, y = (v - lens.cy) / lens.fy;
      const ray = [0, 3, 6].map((i) => R[i] * x + R[i + 1] * y + R[i + 2]), depth = -p[2] / ray[2];
      const px = p[0] + depth * ray[0], py = p[1] + depth * ray[1];
      const inside = Math.abs(c * px + s * py) < this.sides[0] / 2 && Math.abs(c * py - s * px) < this.sides[1] / 2;
      rgba.fill(inside && depth > 0 ? 255 : 0, k, k + 3);
    }
    return rgba;
  }
}
const white = { hue: [0, 360], saturation: [0, 1], value: [0.5, 1], kernelSize: 1 };
const told = [];
for (const { sides, yaw, start, corrected } of given) {
  const arm = new Drawn(sides, yaw, geometry.pose(start.p, start.R));
  const eye = new motion.Eye(arm, new perception.Threshold(white, 320, 240));
  const plan = await planning.plan(eye, { corrected });
  told.push({ outcome: plan.outcome, looks: plan.looks, p: arm.at.p, R: arm.at.R,
    arcs: plan.arcs.map((arc) => ({ angles: motion.anglesOf(arc), ends: arc.ends,
      ratios: arc.views.map((view) => view.blob.ratio) })) });
}
console.log(JSON.stringify(told));
"""


@pytest.mark.parametrize("corrected", [False, True])
def test_a_plan_is_the_librarys_look_for_look(tmp_path, corrected):
    """Centering, depth from motion, the wrist, both arcs, and the quartic; over a plate, on a perfect arm."""
    fit = QuarticFit(x="angle", interpolate=True) if corrected else QuarticFit()
    given, expected = [], []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        arm = Drawn(
            (0.064, 0.032), float(rng.uniform(0, np.pi)), radius=0.29, tilt=0.4, azimuth=float(rng.uniform(0, 6))
        )
        arm.move_camera(turn(rng.uniform(-0.05, 0.05, 3)))
        pose = arm.camera_pose()
        start = {"p": pose.translation.tolist(), "R": pose.rotation.as_matrix().ravel().tolist()}
        given.append({"sides": arm.sides, "yaw": arm.yaw, "start": start, "corrected": corrected})
        expected.append((ImageMomentPlanner(white, fit).plan(arm), arm.camera_pose()))
    found = node(tmp_path, ["geometry", "perception", "motion", "planning"], DRAWN, given)
    for (plan, pose), theirs in zip(expected, found, strict=True):
        assert (theirs["outcome"], theirs["looks"]) == (plan.outcome.value, plan.frames)
        for arc, other in zip(plan.arcs, theirs["arcs"], strict=True):
            np.testing.assert_allclose(other["angles"], arc.angles, atol=1e-6)
            np.testing.assert_allclose(other["ratios"], arc.ratios, atol=1e-6)
            assert other["ends"] == [end.value for end in arc.ends]
        np.testing.assert_allclose(theirs["p"], pose.translation, atol=1e-6)
        np.testing.assert_allclose(np.reshape(theirs["R"], (3, 3)), pose.rotation.as_matrix(), atol=1e-6)
