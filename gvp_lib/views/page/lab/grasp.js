"use strict";
// Grasp completion: gvp_lib.planning.grasp. Thesis 2.3: down along the lens, the object kept in the middle, until the
// range sensor or its median says so; close; lift.
const grasp = (() => {
  const { shift, compose, apply, inverse } = geometry;
  const RADIUS = 0.25, STEP = 0.005, THRESHOLD = 3, LIMIT = 0.3, HEIGHT = 0.1;
  const ENOUGH = 8, CLOSE_ENOUGH = 0.0005, SHUT = 0.001;

  const median = (values) => { const sorted = [...values].sort((a, b) => a - b); return sorted[sorted.length >> 1]; };

  /** How far the hand has yet to go, m: RangeThreshold, the thesis's. */
  const threshold = (distance = 0.1) => (readings) => (readings.at(-1).distance < distance ? 0 : Infinity);

  /** The same by all readings, each carried to where the hand is now: SizedDepth without a solid. */
  const byAllReadings = (depth = 0.02) => (readings, hand) => {
    const now = readings.at(-1).gone;
    if (readings.length < ENOUGH) return Infinity;
    return median(readings.map(({ distance, gone }) => distance - (now - gone))) + depth - (hand.tips - hand.sensor);
  };

  /** Down, close, lift; "held", or why not: GraspExecutor.grasp. */
  async function take(cell, eye, { remaining = threshold(), tell = () => {} } = {}) {
    const { lens, scene: { gripper: { hand, stroke } } } = cell, readings = [];
    cell.wake();
    await cell.open();
    let view = await eye.look(), gone = 0;
    if (!view) return { outcome: "target not found", readings };
    tell("Comes down along the lens, until the range sensor says so");
    for (;;) {
      readings.push({ distance: cell.range(), gone });
      const left = remaining(readings, hand);
      if (left < CLOSE_ENOUGH) break;
      if (LIMIT - gone < CLOSE_ENOUGH) return { outcome: "never closed", readings };
      const step = Math.min(STEP, left, LIMIT - gone);
      let aim = shift(0, 0, 0);
      if (view && !view.clipped) {
        const [u, v] = motion.offset(lens, view), ahead = Math.max(RADIUS - gone, hand.palm + 0.05);
        if (Math.max(Math.abs(u), Math.abs(v)) > THRESHOLD) aim = shift(u * ahead / lens.fx, v * ahead / lens.fy, 0);
      }
      const moved = await cell.moveCamera(compose(aim, shift(0, 0, step)));
      if (moved === "contact") {
        let closes = false;
        for (let k = 0; k < 20 && !closes; k++) {
          readings.push({ distance: cell.range(), gone, landed: true });
          closes = remaining(readings, hand) < CLOSE_ENOUGH;
        }
        if (!closes) return { outcome: "never closed", readings };
        break;
      }
      if (moved !== "reached") return { outcome: moved, readings };
      gone += step;
      if (view && !view.clipped) {
        view = await eye.look([lens.cx, lens.cy]);
        if (!view) return { outcome: "target lost", readings };
      }
    }
    tell("Closes its fingers");
    await cell.close();
    if (cell.width < stroke[0] + SHUT) return { outcome: "closed on nothing", readings };
    tell("Lifts, straight up");
    const up = apply(inverse(cell.cameraPose()).R, [0, 0, HEIGHT]);
    const moved = await cell.moveCamera(shift(...up));
    if (moved !== "reached") return { outcome: moved, readings };
    return { outcome: cell.width < stroke[0] + SHUT ? "slipped" : "held", readings };
  }

  return { take, threshold, byAllReadings };
})();
