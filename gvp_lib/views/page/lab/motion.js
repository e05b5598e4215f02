"use strict";
// Motions that a look asks for: gvp_lib.motion. Thesis 2.2, 2.3, A.1, Algorithms 1 and 2; errata 4 and 6 to 12. An arm
// has what EyeInHandArm has, and every motion of it is awaited, so that a page can show it: joints, cameraPose(),
// moveCamera(camera_from_target), moveJoints(q), rotateWrist(angle), lens, and capture(), which gives RGBA pixels. A
// motion is "reached", or why it ended before.
const motion = (() => {
  const { dot, norm, cross, clip, apply, column, rotation, pose, shift, compose, ray, times, transposed } = geometry;
  const FARTHEST = 0.5, SIDEWAYS = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]];

  /** What was seen, and from where: View. */
  const viewOf = (arm, blob) => ({ joints: arm.joints, pose: arm.cameraPose(), blob,
    clipped: blob.touchesBorder(arm.lens.width, arm.lens.height) });
  const lineOfSight = (view) => column(view.pose.R, 2);
  const offset = (lens, { blob: { centroid: [u, v] } }) => [u - lens.cx, v - lens.cy];  // px from the middle

  /** A camera that keeps its eye on one object: Eye. `shown` is told of every look. */
  class Eye {
    constructor(arm, threshold, shown = () => {}) {
      Object.assign(this, { arm, threshold, shown, lens: arm.lens, tracker: new perception.Tracker(), looks: 0 });
    }

    async look(expected = null) {
      const rgba = await this.arm.capture(), { width, height } = this.lens, mask = this.threshold.mask(rgba);
      this.looks++;
      const blob = this.tracker.observe(mask, width, height, expected), view = blob && viewOf(this.arm, blob);
      await this.shown(view, rgba, mask);
      return view;
    }

    /** Before a look from elsewhere: the object in the middle, so many times as large. */
    expect(view, growth = 1) {
      const area = view && Math.max(1, Math.round(view.blob.area * growth ** 2));
      this.tracker.expect(view && { area, centroid: [this.lens.cx, this.lens.cy] });
    }
  }

  /** Yaw, then pitch, after which the lens points where a pixel is now: toward_pixel. */
  function towardPixel(lens, pixel) {
    const [x, y, z] = ray(lens, pixel);
    return times(rotation([0, Math.atan2(x, z), 0]), rotation([-Math.atan2(y, Math.hypot(x, z)), 0, 0]));
  }

  /** Depth after a translation of the camera by a point's pixels before and after, m: estimate_depth, Eq. A.1. */
  function estimateDepth(lens, translation, before, after) {
    const [u, v] = [before[0] - lens.cx, before[1] - lens.cy], [x, y, z] = translation;
    const moved = [-lens.fx * x + u * z, -lens.fy * y + v * z];
    const closer = dot(moved, [after[0] - before[0], after[1] - before[1]]) / dot(moved, moved);
    return closer > 0 ? 1 / closer : Infinity;
  }

  /** Distance from the lens to a point by its depth and pixel, m: range_to. */
  const rangeTo = (lens, depth, pixel) => depth * norm(ray(lens, pixel));

  /** The object to the middle of the image, by turning or, its depth given, by shifting: center_on_object. */
  async function centerOnObject(eye, { depth = null, threshold = 2, attempts = 8 } = {}) {
    const { lens, arm } = eye;
    let view = await eye.look(), moved = "reached", done = false;
    for (let attempt = 0; view && attempt <= attempts; attempt++) {
      const [u, v] = offset(lens, view);
      done = Math.max(Math.abs(u), Math.abs(v)) < threshold;
      if (done || attempt === attempts || moved !== "reached") break;
      const target = depth === null ? pose([0, 0, 0], towardPixel(lens, view.blob.centroid))
        : shift(u * depth / lens.fx, v * depth / lens.fy, 0);
      moved = await arm.moveCamera(target);
      view = await eye.look(moved === "reached" ? [lens.cx, lens.cy] : null);
    }
    return { view, moved, outcome: ended(done, view, moved, "not centered") };
  }

  function ended(done, view, moved, otherwise) {
    if (done) return "reached";
    if (moved !== "reached") return moved;
    return view ? otherwise : "target lost";
  }

  /** The roll, rad, that brings the camera's y onto a major axis: missing_roll. */
  function missingRoll(orientation) {
    const roll = orientation - 0.5 * Math.PI;
    return roll <= -0.5 * Math.PI ? roll + Math.PI : roll;
  }

  /** The wrist turned until the camera's y lies along the major axis: align_with_major_axis. */
  async function alignWithMajorAxis(eye, { tolerance = Math.PI / 180, attempts = 3, view = null } = {}) {
    const { lens, arm } = eye;
    let moved = "reached", aligned = false, defined = true;
    view ??= await eye.look();
    for (let attempt = 0; view && attempt <= attempts; attempt++) {
      let roll = missingRoll(view.blob.orientation);
      [aligned, defined] = [Math.abs(roll) < tolerance, !Number.isNaN(roll)];
      if (aligned || !defined || attempt === attempts || moved !== "reached") break;
      moved = await arm.rotateWrist(roll);
      if (moved === "joint limit") {
        roll -= Math.sign(roll) * Math.PI;
        moved = await arm.rotateWrist(roll);
      }
      const [u, v] = offset(lens, view), [c, s] = [Math.cos(roll), Math.sin(roll)];
      view = await eye.look(moved === "reached" ? [lens.cx + c * u + s * v, lens.cy + c * v - s * u] : null);
    }
    return { view, moved, outcome: ended(aligned, view, moved, defined ? "out of steps" : "any angle") };
  }

  /** What the camera sees after a sidestep, and the range to it, m: _measured. */
  async function measured(eye, before, step, distance) {
    const { lens } = eye, pixel = before.blob.centroid;
    const after = await eye.look([pixel[0] - lens.fx * step[0] / distance, pixel[1] - lens.fy * step[1] / distance]);
    if (!after) return [null, NaN];
    return [after, rangeTo(lens, estimateDepth(lens, step, pixel, after.blob.centroid), after.blob.centroid)];
  }

  /** Toward the object of a view and on along the new line of sight, in one motion; then centered: _recenter. */
  async function recenter(eye, view, distance, advance, threshold) {
    eye.expect(view, advance ? distance / (distance - advance) : 1);
    const toward = pose([0, 0, 0], towardPixel(eye.lens, view.blob.centroid));
    const moved = await eye.arm.moveCamera(compose(toward, shift(0, 0, advance)));
    return moved === "reached" ? centerOnObject(eye, { threshold }) : { view, moved, outcome: moved };
  }

  /** To the radius from the object, centered on it, by depth from motion alone: approach. */
  async function approach(eye, radius, { step = 0.02, tolerance = 0.05, attempts = 4 } = {}) {
    let centered = await centerOnObject(eye), { view, moved } = centered, arrived = false, attempt = 0;
    for (; attempt < attempts && view && centered.outcome === "reached"; attempt++) {
      let sidestep;
      for (let k = 0; k < 4; k++) {
        sidestep = SIDEWAYS[(attempt + k) % 4].map((x) => step * x);
        moved = await eye.arm.moveCamera(shift(...sidestep));
        if (moved === "reached" || (await eye.arm.moveJoints(view.joints)) !== "reached") break;
      }
      if (moved !== "reached") return { view, moved, outcome: moved };
      const [looked, distance] = await measured(eye, view, sidestep, radius);
      if (!looked) return { view: null, moved, outcome: "target lost" };
      const known = Number.isFinite(distance), missing = known ? distance - radius : 0;
      centered = await recenter(eye, looked, distance, missing, 2);
      [view, moved] = [centered.view, centered.moved];
      arrived = centered.outcome === "reached" && known && Math.abs(missing) < tolerance * radius;
      if (arrived) break;
    }
    if (attempt === attempts && centered.outcome === "reached") moved = "reached";  // near enough to go on from
    const otherwise = centered.outcome === "reached" ? "out of steps" : "not centered";
    return { view, moved, outcome: ended(arrived, view, moved, otherwise) };
  }

  /** The next view of an arc and its range, or why there is none: _next_view. */
  async function nextView(eye, last, distance, step, radius, threshold) {
    const moved = await eye.arm.moveCamera(shift(...step));
    if (moved !== "reached") return moved;
    const [looked, range] = await measured(eye, last, step, distance);
    if (!looked) return "target lost";
    const missing = Math.abs(range - radius) < FARTHEST * radius ? clip(range - radius, -norm(step), norm(step)) : 0;
    const centered = await recenter(eye, looked, range, missing, threshold);
    if (!centered.view) return "target lost";
    return centered.outcome === "reached" ? [centered.view, range] : centered.outcome;
  }

  /** Views to both sides along one of the camera's axes, until something ends each: traverse_arc, Algorithm 2. */
  async function traverseArc(eye, axis, { radius = 0.25, step = 0.02, maxAngle = Math.PI / 3, threshold = 2 } = {}) {
    const start = await eye.look(), sides = { 1: [], "-1": [] }, ends = {};
    if (!start) return { axis, views: [], center: -1, ends: ["target lost", "target lost"] };
    for (const sign of [1, -1]) {
      let last = start, distance = radius;
      while (!ends[sign]) {
        const along = axis === "y" ? [0, sign * step, 0] : [sign * step, 0, 0];
        const found = await nextView(eye, last, distance, along, radius, threshold);
        if (typeof found === "string") { ends[sign] = found; break; }
        sides[sign].push(found);
        [last, distance] = found;
        const [a, b] = [lineOfSight(start), lineOfSight(last)];
        if (Math.atan2(norm(cross(a, b)), dot(a, b)) >= maxAngle) ends[sign] = "max angle";
      }
      let back = await eye.arm.moveJoints(start.joints);
      const way = back === "reached" ? [] : [...sides[sign].map(([view]) => view).reverse(), start];
      for (const view of way) back = await eye.arm.moveJoints(view.joints);
      eye.expect(start);
      if (back === "reached" && ends[sign] === "target lost" && !(await eye.look())) back = "target lost";
      if (back !== "reached") { ends[-sign] ??= back; break; }
    }
    const [below, above] = [sides[-1].map(([view]) => view).reverse(), sides[1].map(([view]) => view)];
    return { axis, views: [...below, start, ...above], center: below.length, ends: [ends[-1], ends[1]] };
  }

  /** Angles of an arc's views from its center, rad: Arc.angles. */
  function anglesOf({ axis, views, center }) {
    const back = transposed(views[center].pose.R);
    return views.map((view) => {
      const [x, y, z] = apply(back, lineOfSight(view));
      return -Math.atan2(axis === "y" ? y : x, z);
    });
  }

  return { Eye, offset, towardPixel, estimateDepth, rangeTo, centerOnObject, alignWithMajorAxis, missingRoll,
    approach, traverseArc, anglesOf, lineOfSight };
})();
