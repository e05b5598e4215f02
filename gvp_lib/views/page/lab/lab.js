"use strict";
// The laboratory's page: what a reader does, and what is shown of it.
(() => {
  const $ = (id) => document.getElementById(id), RAD = Math.PI / 180, FRAME = 0.05;  // s of simulated time to a frame
  const calm = matchMedia("(prefers-reduced-motion: reduce)");
  const stats = {};
  let mj, view, cell, eye, threshold, scenes, noises;
  let [sphere, last, curve, busy, stopped, passed] = [null, null, null, false, false, 0];

  class Stopped extends Error {}
  const say = (text) => { $("status").textContent = text; };
  const fail = (error) => {
    console.error(error);
    $("message").textContent = error.message ?? String(error);
    $("message").hidden = false;
    document.documentElement.dataset.lab = "failed";
  };
  const frame = () => new Promise((done) => { (document.hidden ? setTimeout : requestAnimationFrame)(done); });

  async function unpacked(base64) {
    const bytes = Uint8Array.from(atob(base64), (each) => each.charCodeAt(0));
    return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
  }

  // --- what is shown ---

  /** Called as simulated time passes; draws, now and then, and lets the reader stop it. */
  async function shown(seconds) {
    passed += seconds;
    if (stopped) throw new Stopped();
    if (passed < (calm.matches ? 10 * FRAME : FRAME)) return;
    passed = 0;
    const began = performance.now();
    view.draw(cell);
    stats.frameMs = performance.now() - began;
    await frame();
  }

  /** Every look: the hand's picture, mask and ellipse, and their numbers. */
  async function looked(found, rgba, mask) {
    last = found;
    paint(rgba, mask);
    tell();
    view.draw(cell);
    if (stopped) throw new Stopped();
    if (!calm.matches) await frame();
  }

  function paint(rgba, mask) {
    const { width, height } = cell.lens, canvas = $("hand"), pen = canvas.getContext("2d"), dim = $("mask").checked;
    if (canvas.width !== width) Object.assign(canvas, { width, height });
    const picture = new ImageData(new Uint8ClampedArray(rgba), width, height), { data } = picture;
    for (let k = 0, at = 0; k < mask.length; k++, at += 4) {
      data[at + 3] = 255;
      if (dim && !mask[k]) for (let c = 0; c < 3; c++) data[at + c] *= 0.25;
    }
    pen.putImageData(picture, 0, 0);
    if (!last) return;
    const { centroid: [u, v], major, minor, orientation } = last.blob, angle = orientation || 0;
    pen.lineWidth = width / 213;
    pen.strokeStyle = "#d55e00";
    pen.beginPath();
    pen.ellipse(u, v, major / 2, minor / 2, angle, 0, 2 * Math.PI);
    for (const [half, turned] of [[major / 2, angle], [minor / 2, angle + Math.PI / 2]]) {
      const [x, y] = [half * Math.cos(turned), half * Math.sin(turned)];
      pen.moveTo(u - x, v - y);
      pen.lineTo(u + x, v + y);
    }
    pen.stroke();
  }

  function tell() {
    const parts = [];
    if (last) {
      const { area, centroid: [u, v], major, minor, ratio } = last.blob;
      parts.push(`area ${area} px`, `centroid (${u.toFixed(1)}, ${v.toFixed(1)})`,
        `axes ${major.toFixed(1)} and ${minor.toFixed(1)} px`, `ratio ${ratio.toFixed(3)}`);
    } else parts.push("the object is not in sight");
    if ($("truth").checked) parts.push(`in truth ${(cell.error / RAD).toFixed(1)} deg off its normal`);
    $("numbers").textContent = parts.join(", ");
  }

  /** The last arc's ratios, its polynomial, and the place that was chosen. */
  function plot() {
    const canvas = $("curve"), pen = canvas.getContext("2d"), style = getComputedStyle(document.documentElement);
    const [width, height] = [canvas.width, canvas.height] = [640, 266];
    const color = (name) => style.getPropertyValue(name).trim();
    pen.clearRect(0, 0, width, height);
    if (!curve) return;
    const { arc, optimum } = curve, ratios = arc.views.map((each) => each.blob.ratio);
    const angles = motion.anglesOf(arc).map((angle) => angle / RAD);
    const low = Math.floor(Math.min(...angles) / 10) * 10, high = Math.ceil(Math.max(...angles) / 10) * 10;
    const bottom = Math.max(0, Math.floor(Math.min(...ratios) * 10 - 0.5) / 10);
    const top = Math.min(1.05, Math.ceil(Math.max(...ratios) * 10 + 0.5) / 10);
    const x = (angle) => 46 + ((width - 60) * (angle - low)) / (high - low);
    const y = (ratio) => height - 28 - ((height - 40) * (ratio - bottom)) / (top - bottom);
    pen.font = "13px system-ui, sans-serif";
    pen.fillStyle = color("--text");
    pen.strokeStyle = color("--line");
    for (let angle = low; angle <= high; angle += 10) {
      pen.strokeRect(x(angle), 12, 0, height - 40);
      pen.fillText(`${angle}°`, x(angle) - 10, height - 10);
    }
    for (let ratio = bottom; ratio <= top + 1e-9; ratio += 0.1) {
      pen.strokeRect(46, y(ratio), width - 60, 0);
      pen.fillText(ratio.toFixed(1), 18, y(ratio) + 4);
    }
    pen.fillStyle = color("--accent");
    angles.forEach((angle, k) => { pen.beginPath(); pen.arc(x(angle), y(ratios[k]), 3.5, 0, 7); pen.fill(); });
    if (!optimum?.quartic) return;
    const { quartic: { value, chosen }, xs } = optimum;
    const between = (place) => {  // angle of a place on the polynomial's axis
      const k = Math.min(Math.max(1, xs.findIndex((each) => each >= place)), xs.length - 1);
      return angles[k - 1] + ((place - xs[k - 1]) / (xs[k] - xs[k - 1])) * (angles[k] - angles[k - 1]);
    };
    pen.lineWidth = 2;
    pen.strokeStyle = color("--curve");
    pen.beginPath();
    for (let k = 0; k <= 100; k++) {
      const place = xs[0] + ((xs.at(-1) - xs[0]) * k) / 100;
      pen.lineTo(x(between(place)), y(value(place)));
    }
    pen.stroke();
    pen.strokeStyle = color("--chosen");
    pen.setLineDash([5, 4]);
    pen.strokeRect(x(between(chosen)), 12, 0, height - 40);
    pen.setLineDash([]);
  }

  // --- what the arm does ---

  /** One thing at a time; the buttons wait. */
  async function run(task) {
    if (busy) return;
    [busy, stopped] = [true, false];
    for (const each of document.querySelectorAll("#act button, #settings select")) each.disabled = each.id !== "stop";
    try {
      await task();
    } catch (error) {
      if (error instanceof Stopped) say("Stopped");
      else fail(error);
    }
    busy = false;
    for (const each of document.querySelectorAll("#act button, #settings select")) each.disabled = each.id === "stop";
    if (!cell) return;
    $("grasp").disabled = !cell.scene.gripper || cell.scene.servos.includes(null);
    view.draw(cell);
  }

  const tasks = {
    center: async () => { say("Centers the object"); said(await motion.centerOnObject(eye)); },
    align: async () => { say("Turns the wrist along the major axis"); said(await motion.alignWithMajorAxis(eye)); },
    arc: async () => {
      say("Centers the object, and sweeps an arc along the camera's y");
      const came = await motion.approach(eye, 0.25);
      if (came.outcome !== "reached") return said(came);
      const arc = await motion.traverseArc(eye, "y"), optimum = planning.estimate(arc, options());
      show({ arc, optimum });
      say(`${arc.views.length} views, ended by ${arc.ends.join(" and ")}; the quartic says: ${optimum.outcome}`);
    },
    plan: async () => {
      const tell = (text, found) => { say(text); if (found) show(found); };
      const found = await planning.plan(eye, { ...options(), tell });
      say(`The plan ended: ${found.outcome}, after ${found.looks} pictures${judged()}`);
      eye.looks = 0;
    },
    grasp: async () => {
      const remaining = $("median").checked ? grasp.byAllReadings() : grasp.threshold();
      const { outcome, readings } = await grasp.take(cell, eye, { remaining, tell: say });
      const rose = outcome === "held" ? `; the object rose by ${(100 * cell.risen).toFixed(0)} cm` : "";
      say(`The grasp ended: ${outcome}, after ${readings.length} readings of the range sensor${rose}`);
    },
    reset: async () => begin(),
  };
  const show = (found) => { curve = found; plot(); };
  const options = () => ({ corrected: $("corrected").checked });
  const said = ({ outcome }) => say(outcome === "reached" ? "Done" : `It ended: ${outcome}`);
  const judged = () => ($("truth").checked ? `; in truth ${(cell.error / RAD).toFixed(1)} deg off` : "");

  /** The episode from its start; the sphere is where the arm itself finds the object. */
  async function begin() {
    cell.begin(noises[$("noise").value], seedOf());
    view.focus(cell.noise.focalScale);
    eye = new motion.Eye(cell, threshold, looked);
    [curve, sphere, last] = [null, null, null];
    view.showSphere(null);
    plot();
    say("Centers the object, and comes to the sphere by its own motion");
    const came = await motion.approach(eye, 0.25);
    if (!came.view) return say("The object is not in sight");
    const { p, R } = cell.cameraPose(), at = geometry.column(R, 2);
    sphere = { center: geometry.add(p, at, 0.25), radius: 0.25 };
    view.showSphere(sphere);
    steer(at.map((x) => -x));
    say("Ready");
  }
  const seedOf = () => Number(new URLSearchParams(location.hash.slice(1)).get("seed") ?? 1);

  /** The sliders to a direction from the sphere's center. */
  function steer([x, y, z]) {
    $("tilt").value = Math.acos(geometry.clip(z, -1, 1)) / RAD;
    $("azimuth").value = Math.atan2(y, x) / RAD;
    labels();
  }

  /** The camera to where the sliders say, along its sphere. */
  async function fly() {
    labels();
    if (!sphere || busy) return;
    await run(async () => {
      const goal = geometry.viewpoint(sphere.center, sphere.radius, $("tilt").value * RAD, $("azimuth").value * RAD);
      const here = cell.cameraPose(), turned = (roll) => geometry.compose(goal, geometry.turn([0, 0, roll]));
      const rolls = [0, 1, 2, 3].map((k) => turned((k * Math.PI) / 2));  // with the least turn of the wrist
      rolls.sort((a, b) => angleTo(here, a) - angleTo(here, b));
      const moved = await cell.moveCamera(geometry.compose(geometry.inverse(here), rolls[0]));
      eye.expect(null);
      await eye.look();
      say(moved === "reached" ? "There" : `The arm stops: ${moved}`);
    });
  }
  const angleTo = (a, b) => geometry.norm(geometry.vector(geometry.compose(geometry.inverse(a), b).R));
  function labels() {
    for (const each of document.querySelectorAll("output")) each.textContent = `${Math.round($(each.htmlFor).value)}°`;
  }

  // --- the page ---

  async function take(name) {
    cell?.dispose();
    const scene = scenes[name];
    await view.show(scene);
    threshold = new perception.Threshold(scene.ranges, scene.lens.width, scene.lens.height);
    cell = new simulation.Cell(mj, scene, { draw: (each) => view.capture(each), shown });
    sliders(scene.ranges);
    await begin();
  }

  function sliders(ranges) {
    $("thresholds").replaceChildren(...["hue", "saturation", "value"].flatMap((name) => [0, 1].map((end) => {
      const label = document.createElement("label"), input = document.createElement("input");
      const [most, step] = name === "hue" ? [360, 1] : [1, 0.01];
      Object.assign(input, { type: "range", min: 0, max: most, step, value: ranges[name][end] });
      input.oninput = async () => {
        const ends = threshold.ranges[name].map((old, k) => (k === end ? Number(input.value) : old));
        const { width, height } = cell.lens, changed = { ...threshold.ranges, [name]: ends };
        threshold = eye.threshold = new perception.Threshold(changed, width, height);
        if (!busy) { eye.expect(null); await run(() => eye.look()); }
      };
      label.append(`${name}, ${end ? "to" : "from"} `, input);
      return label;
    })));
  }

  function listen() {
    for (const [id, task] of Object.entries(tasks)) $(id).onclick = () => run(task);
    $("stop").onclick = () => { stopped = true; };
    $("scene").onchange = () => run(() => take($("scene").value));
    $("noise").onchange = () => run(begin);
    for (const id of ["tilt", "azimuth"]) $(id).onchange = fly;
    for (const id of ["tilt", "azimuth"]) $(id).oninput = labels;
    $("truth").onchange = tell;
    $("mask").onchange = () => run(() => eye.look());
    $("link").onclick = async () => {
      await navigator.clipboard.writeText(`${location.href.split("#")[0]}#${new URLSearchParams(settings())}`);
      say("The link is copied");
    };
    const keys = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    const nudge = (across, up) => {
      $("azimuth").value = Number($("azimuth").value) + 5 * across;
      $("tilt").value = Number($("tilt").value) + 5 * up;
      fly();
    };
    $("hand").onkeydown = (event) => { if (keys[event.key]) { event.preventDefault(); nudge(...keys[event.key]); } };
    $("overview").onkeydown = (event) => {
      const [across, up] = keys[event.key] ?? [0, 0], nearer = { "+": 0.9, "-": 1.1 }[event.key] ?? 1;
      if (!across && !up && nearer === 1) return;
      event.preventDefault();
      view.orbit(0.1 * across, 0.1 * up, nearer);
      view.draw(cell);
    };
    const drag = (canvas, moved) => {
      let from = null;
      canvas.onpointerdown = (event) => {
        from = [event.clientX, event.clientY];
        canvas.setPointerCapture(event.pointerId);
        moved(null, null, event, false);
      };
      canvas.onpointerup = canvas.onpointercancel = (event) => { if (from) moved(0, 0, event, true); from = null; };
      canvas.onpointermove = (event) => {
        if (!from) return;
        moved(event.clientX - from[0], event.clientY - from[1], event, false);
        from = [event.clientX, event.clientY];
      };
    };
    let flies = false;  // whether what is dragged is the sphere
    drag($("overview"), (across, down, event, over) => {
      const at = view.pointed(event);
      if (over) return void (flies && fly());
      if (across === null) flies = Boolean(at);
      else if (flies && at) steer(at);
      else if (!flies) { view.orbit(across / 150, down / 150); view.draw(cell); }
    });
    drag($("hand"), (across, down, event, over) => {
      if (over) return void fly();
      if (across === null) return;
      $("azimuth").value = Number($("azimuth").value) - across / 2;
      $("tilt").value = Number($("tilt").value) + down / 2;
      labels();
    });
    addEventListener("resize", () => { view.fit(); view.draw(cell); });
    addEventListener("message", ({ data }) => {
      if (["dark", "light"].includes(data?.gvpTheme)) { document.documentElement.className = data.gvpTheme; plot(); }
    });
  }

  const kept = ["scene", "noise", "mask", "corrected", "median", "truth"];
  const set = (control) => (control.type === "checkbox" ? String(control.checked) : control.value);
  const settings = () => Object.fromEntries(kept.map((id) => [id, set($(id))]));
  function restore() {
    for (const [id, value] of new URLSearchParams(location.hash.slice(1))) if (kept.includes(id)) {
      if ($(id).type === "checkbox") $(id).checked = value === "true";
      else if ([...$(id).options].some((each) => each.value === value)) $(id).value = value;
    }
  }

  async function start() {
    const began = performance.now();
    view = new pictures.Pictures($("overview"));
    say("Unpacks MuJoCo");
    const [payload, wasmBinary] = await Promise.all([unpacked($("payload").textContent), unpacked(MUJOCO_WASM)]);
    ({ scenes, noises } = JSON.parse(new TextDecoder().decode(payload)));
    mj = await loadMujoco({ wasmBinary });
    $("scene").replaceChildren(...Object.keys(scenes).map((name) => new Option(name, name)));
    $("scene-label").hidden = Object.keys(scenes).length < 2;
    restore();
    listen();
    await run(() => take($("scene").value));
    stats.readyMs = performance.now() - began;
    document.documentElement.dataset.lab = "ready";
    parent.postMessage({ gvpScene: "ready" }, "*");
  }

  // For tests, and for who wants to look behind.
  globalThis.lab = { stats, run, tasks, get cell() { return cell; }, get eye() { return eye; },
    get curve() { return curve; } };
  start().catch(fail);
})();
