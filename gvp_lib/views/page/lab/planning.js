"use strict";
// The thesis's planner: gvp_lib.planning.image_moments. Thesis 2.3, Algorithm 3; errata 12 to 15.
const planning = (() => {
  const { solve } = geometry;
  const LEAST_RANGE = 0.012;

  /** The ratios of an arc by a polynomial, its level places, and the one that counts: QuarticFit.fit. */
  function fit(xs, ys, center, order = 4) {
    const [low, high] = [Math.min(...xs), Math.max(...xs)], n = order + 1;
    const scaled = (x) => (2 * x - low - high) / (high - low);
    const basis = xs.map((x) => legendre(scaled(x), n));  // well conditioned, so that normal equations do
    const normal = range(n).map((i) => range(n).map((j) => basis.reduce((sum, row) => sum + row[i] * row[j], 0)));
    const weights = solve(normal, range(n).map((i) => basis.reduce((sum, row, k) => sum + row[i] * ys[k], 0)));
    const value = (x) => legendre(scaled(x), n).reduce((sum, p, i) => sum + p * weights[i], 0);
    const powers = inPowers(weights), slope = powers.slice(1).map((a, i) => a * (i + 1));
    const level = realRoots(slope).map((t) => (t * (high - low) + low + high) / 2);
    const inside = level.filter((x) => x >= low && x <= high);
    const middle = level.length % 2 ? level[level.length >> 1] : NaN;
    let chosen = center;
    if (middle >= low && middle <= high) chosen = middle;
    else if (inside.length) chosen = inside.reduce((a, b) => (Math.abs(b - center) < Math.abs(a - center) ? b : a));
    return { value, level: inside, chosen };
  }

  const range = (n) => Array.from({ length: n }, (_, i) => i);

  /** Legendre's polynomials of order 0 to n - 1 at t. */
  function legendre(t, n) {
    const p = [1, t];
    for (let k = 2; k < n; k++) p.push(((2 * k - 1) * t * p[k - 1] - (k - 1) * p[k - 2]) / k);
    return p.slice(0, n);
  }

  /** A sum of them by its coefficients of 1, t, t^2 and so on. */
  function inPowers(weights) {
    const n = weights.length, polynomials = [[1], [0, 1]];
    for (let k = 2; k < n; k++) {
      const next = new Array(k + 1).fill(0);
      polynomials[k - 1].forEach((a, i) => { next[i + 1] += ((2 * k - 1) * a) / k; });
      polynomials[k - 2].forEach((a, i) => { next[i] -= ((k - 1) * a) / k; });
      polynomials.push(next);
    }
    return range(n).map((i) => weights.reduce((sum, w, k) => sum + w * (polynomials[k][i] ?? 0), 0));
  }

  /** Real roots of a polynomial, ascending: between those of its derivative it rises or falls, and is halved there. */
  function realRoots(powers) {
    let degree = powers.length - 1;
    while (degree > 0 && powers[degree] === 0) degree--;
    if (degree < 1) return [];
    const at = (t) => powers.slice(0, degree + 1).reduceRight((sum, a) => sum * t + a, 0);
    const reach = 1 + Math.max(...powers.slice(0, degree).map((a) => Math.abs(a / powers[degree])));  // Cauchy's bound
    const turns = realRoots(powers.slice(1, degree + 1).map((a, i) => a * (i + 1)));
    const ends = [-reach, ...turns, reach], roots = [];
    for (let k = 0; k + 1 < ends.length; k++) {
      let [low, high] = [ends[k], ends[k + 1]];
      if (at(low) === 0 || at(low) * at(high) > 0) continue;
      for (let i = 0; i < 100; i++) {
        const middle = 0.5 * (low + high);
        if (at(low) * at(middle) <= 0) high = middle;
        else low = middle;
      }
      roots.push(0.5 * (low + high));
    }
    return roots;
  }

  /** Where a quartic through an arc's ratios says to go: QuarticFit.estimate. As printed it counts views and goes to
   * one of them; as corrected it goes by the angle, and between them. */
  function estimate(arc, { corrected = false, order = 4 } = {}) {
    const { views, center } = arc, ratios = views.map((view) => view.blob.ratio);
    if (views.length < order + 1) return { outcome: "too few views", joints: views[center].joints };
    const xs = corrected ? motion.anglesOf(arc) : range(views.length), quartic = fit(xs, ratios, xs[center], order);
    const spread = Math.max(...ratios) - Math.min(...ratios);
    if (spread < LEAST_RANGE) return { outcome: "any angle", joints: views[center].joints, quartic, xs };
    const place = placeOf(xs, quartic.chosen), exact = corrected ? place : roundEven(place);
    const k = Math.floor(exact), share = exact - k;
    const next = views[Math.min(k + 1, views.length - 1)].joints;
    const joints = views[k].joints.map((q, i) => (1 - share) * q + share * next[i]);
    return { outcome: quartic.level.length ? "aligned" : "no stationary point", joints, quartic, xs };
  }

  /** The fractional number of a place among ascending ones. */
  function placeOf(xs, x) {
    const k = Math.min(Math.max(xs.findIndex((each) => each > x), 1), xs.length - 1), high = xs[xs.length - 1];
    if (x >= high) return xs.length - 1;
    return Math.max(0, k - 1 + (x - xs[k - 1]) / (xs[k] - xs[k - 1]));
  }

  const roundEven = (x) => (Math.abs(x % 1) === 0.5 ? 2 * Math.round(x / 2) : Math.round(x));

  /** Algorithm 3: two arcs, the wrist along the major axis before each, and after each where the quartic says. `tell`
   * says what is done next, and shows what was found. */
  async function plan(eye, { radius = 0.25, corrected = false, tell = () => {} } = {}) {
    const arcs = [], optima = [], finish = (outcome) => ({ outcome, arcs, optima, looks: eye.looks });
    tell("Centers the object, and comes to the radius by its own motion");
    if (!(await eye.look())) return finish("target not found");
    let { view, moved } = await motion.approach(eye, radius);
    if (moved !== "reached" || !view) return finish(view ? moved : "target lost");
    for (const axis of ["y", "x"]) {
      tell("Turns the wrist along the major axis");
      const aligned = await motion.alignWithMajorAxis(eye, { view });
      if (aligned.moved !== "reached" || !aligned.view) return finish(aligned.view ? aligned.moved : "target lost");
      tell(`Sweeps an arc along the camera's ${axis}`);
      const arc = await motion.traverseArc(eye, axis, { radius });
      if (!arc.views.length) return finish("target lost");
      const optimum = estimate(arc, { corrected });
      arcs.push(arc);
      optima.push(optimum);
      tell("Goes where the quartic is level", { arc, optimum });
      ({ view, moved } = await takeUp(eye, arc, optimum));
      if (moved !== "reached" || !view) return finish(view ? moved : "target lost");
    }
    const last = await motion.alignWithMajorAxis(eye, { view });
    if (last.moved !== "reached" || !last.view) return finish(last.view ? last.moved : "target lost");
    const found = optima.map((each) => each.outcome);
    const worst = ["too few views", "no stationary point", "any angle"].find((each) => found.includes(each));
    return finish(worst ?? "aligned");
  }

  /** Where the optimum is, straight or, where something is in the way, along the arc; and centered: take_up. */
  async function takeUp(eye, arc, { joints }) {
    const apart = arc.views.map((view) => Math.max(...view.joints.map((q, i) => Math.abs(q - joints[i]))));
    const nearest = apart.indexOf(Math.min(...apart)), sign = nearest >= arc.center ? 1 : -1;
    let moved = await eye.arm.moveJoints(joints);
    if (moved !== "reached") {
      for (let k = arc.center; k !== nearest; k += sign) moved = await eye.arm.moveJoints(arc.views[k].joints);
      moved = await eye.arm.moveJoints(joints);
    }
    eye.expect(arc.views[nearest]);
    if (moved !== "reached") return { view: await eye.look(), moved };
    const centered = await motion.centerOnObject(eye);
    const stopped = centered.moved !== "reached" || !centered.view;
    return { view: centered.view, moved: stopped ? centered.moved : centered.outcome };
  }

  return { fit, estimate, plan };
})();
