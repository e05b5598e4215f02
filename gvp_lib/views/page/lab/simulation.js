"use strict";
// The work cell in the page: gvp_lib.simulation, over MuJoCo. An arm that moves at once and stops before a collision,
// or by servos and contacts; its gripper and range sensor; the noise of a cheap one. Only the judge sees the truth.
const simulation = (() => {
  const { dot, norm, clip, column, apply, rotation, vector, pose, turn, compose, inverse, solve, times,
    transposed } = geometry;
  const LINE_STEP = 0.01, TURN_STEP = Math.PI / 90, JOINT_STEP = 0.03, MAX_JOINT_JUMP = 0.5, AT_LIMIT = Math.PI / 360;
  const CLOSE = 1e-4, CLOSE_ANGLE = Math.PI / 3600, DAMPING = 1e-8, MAX_TURN = 0.6, PACE = 0.25, STOP_FORCE = 15;
  const SETTLED = 0.02 * Math.PI / 180, ARRIVED = Math.PI / 180, CONE = 1.5 * Math.PI / 180, REACH = [0.04, 0.4];
  const part = (array, number, size) => [...array.subarray(size * number, size * (number + 1))];
  const FLIP = [1, 0, 0, 0, -1, 0, 0, 0, -1];  // MuJoCo's cameras look along -z, y up

  const QUIET = Object.fromEntries(["joint_offset_sd", "repeatability_sd", "pixel_sd", "exposure", "focal_length",
    "range_bias", "range_sd", "range_dropout", "range_spike"].map((name) => [name, 0]));

  /** Random numbers of a seed: mulberry32. */
  function random(seed) {
    const uniform = () => {
      seed = (seed + 0x6d2b79f5) | 0;
      let t = Math.imul(seed ^ (seed >>> 15), 1 | seed);
      t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
      return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
    };
    const normal = () => Math.sqrt(-2 * Math.log(1 - uniform())) * Math.cos(2 * Math.PI * uniform());
    return { uniform, normal };
  }

  /** One episode's draw of a Noise: EpisodeNoise. */
  class EpisodeNoise {
    constructor(noise, joints, seed) {
      const drawn = random(seed), within = () => 2 * drawn.uniform() - 1;
      Object.assign(this, noise, { random: drawn, gain: 1 + noise.exposure * within(),
        focalScale: 1 + noise.focal_length * within(), bias: noise.range_bias * within() });
      this.offset = Array.from({ length: joints }, () => noise.joint_offset_sd * drawn.normal());
    }

    landing() { return this.offset.map(() => this.repeatability_sd * this.random.normal()); }

    /** Exposure and pixel noise, in place; a window of one field of noise, as in Python. */
    expose(rgba, width, height) {
      if (this.gain === 1 && !this.pixel_sd) return;
      const wide = width + 64;
      if (!this.field) {
        this.field = Int8Array.from({ length: 3 * wide * (height + 64) },
          () => Math.round(this.pixel_sd * this.random.normal()));
      }
      const [u, v] = [Math.floor(65 * this.random.uniform()), Math.floor(65 * this.random.uniform())];
      for (let y = 0, k = 0; y < height; y++) for (let x = 0, n = 3 * ((y + v) * wide + u); x < width; x++, k += 4) {
        for (let c = k; c < k + 3; c++, n++) rgba[c] = clip(Math.round(rgba[c] * this.gain) + this.field[n], 0, 255);
      }
    }

    read(distance) {
      const { random: drawn } = this, chance = drawn.uniform(), error = drawn.normal();
      const spike = REACH[0] + (REACH[1] - REACH[0]) * drawn.uniform();
      if (chance < this.range_dropout) return Infinity;
      if (chance < this.range_dropout + this.range_spike) return spike;
      const reading = distance + this.bias + this.range_sd * error;
      return reading <= REACH[1] ? Math.max(REACH[0], reading) : Infinity;
    }
  }

  /** A compiled scene, its arm and its gripper: WorkCell. `draw` takes a picture; `shown` is told of time that passes,
   * s, and awaited. */
  class Cell {
    constructor(mj, scene, { draw, shown = () => {}, noise = QUIET, seed = 1 }) {
      Object.assign(this, { mj, scene, draw, shown, lens: scene.lens, dynamic: false });
      const m = this.model = mj.MjModel.from_xml_string(scene.xml);
      for (const [name, { at, of }] of Object.entries(scene.arrays)) {  // what the text rounds
        const array = m[name];
        at.forEach((place, k) => { array[place] = of[k]; });
      }
      this.data = new mj.MjData(m);
      this.scratch = new mj.MjData(m);
      this.forces = new mj.DoubleBuffer(6);
      this.jacobian = [new mj.DoubleBuffer(3 * m.nv), new mj.DoubleBuffer(3 * m.nv)];
      const id = (kind, name) => mj.mj_name2id(m, mj.mjtObj[kind].value, name);
      const joints = scene.joints.map((name) => id("mjOBJ_JOINT", name));
      this.qpos = joints.map((j) => m.jnt_qposadr[j]);
      this.dofs = joints.map((j) => m.jnt_dofadr[j]);
      const limits = scene.limits.map((ends) => ends ?? [-Infinity, Infinity]);  // as JSON has them
      [this.low, this.high] = [0, 1].map((end) => limits.map((ends) => ends[end]));
      this.camera = id("mjOBJ_CAMERA", scene.camera);
      this.body = m.cam_bodyid[this.camera];
      this.target = id("mjOBJ_BODY", scene.target);
      const carried = new Set(joints.map((j) => m.jnt_bodyid[j]));
      for (let b = 1; b < m.nbody; b++) if (carried.has(m.body_parentid[b])) carried.add(b);
      this.ofArm = Array.from({ length: m.ngeom }, (_, g) => carried.has(m.geom_bodyid[g]));
      const { gripper } = scene;
      if (gripper) {
        this.fingers = gripper.joints.map((name) => id("mjOBJ_JOINT", name))
          .map((j) => ({ qpos: m.jnt_qposadr[j], body: m.jnt_bodyid[j] }));
        this.actuator = id("mjOBJ_ACTUATOR", gripper.actuator);
        this.site = id("mjOBJ_SITE", gripper.site);
        this.rays = { geoms: new mj.IntBuffer(7), distances: new mj.DoubleBuffer(7) };
      }
      this.begin(noise, seed);
    }

    dispose() {
      const buffers = [this.forces, ...this.jacobian, ...(this.rays ? [this.rays.geoms, this.rays.distances] : [])];
      for (const each of [...buffers, this.scratch, this.data, this.model]) each.delete();
    }

    /** The episode from its start: WorkCell.reset. */
    begin(noise = this.noise, seed = 1) {
      const { mj, model, data, scene } = this;
      mj.mj_resetData(model, data);
      data.qpos.set(scene.qpos);
      data.ctrl.set(scene.ctrl);
      if (scene.mocap) [data.mocap_pos.set(scene.mocap.pos), data.mocap_quat.set(scene.mocap.quat)];
      this.noise = new EpisodeNoise(noise, this.qpos.length, seed);
      this.landing = this.qpos.map(() => 0);
      this.dynamic = false;
      this.held = new Set();
      this.put(scene.home.map((q, i) => q + this.noise.offset[i]));
      mj.mj_forward(model, data);
      this.lifted = data.xpos[3 * this.target + 2];
    }

    // --- the arm: SimulatedArm ---

    get truth() { return this.qpos.map((at) => this.data.qpos[at]); }
    get joints() { return this.truth.map((q, i) => q - this.noise.offset[i] - this.landing[i]); }
    cameraPose() { return this.forward(this.joints); }

    /** base_from_camera of joint angles, by the kinematics that the arm believes. */
    forward(q) {
      this.setJoints(this.scratch, q);
      return this.poseOf(this.scratch);
    }

    poseOf(data) {
      return pose(part(data.cam_xpos, this.camera, 3), times(part(data.cam_xmat, this.camera, 9), FLIP));
    }

    setJoints(data, q) {
      const { mj, model } = this, all = data.qpos;
      this.qpos.forEach((at, i) => { all[at] = q[i]; });
      mj.mj_kinematics(model, data);
      mj.mj_comPos(model, data);
      mj.mj_camlight(model, data);
    }

    /** Joint angles that put the camera at a pose, by damped least squares from q; null where it does not get there. */
    inverseKinematics(goal, q, iterations = 30) {
      const { mj, model, scratch, dofs, low, high } = this, n = q.length, nv = model.nv;
      scratch.qpos.set(this.data.qpos);
      q = q.map((x, i) => clip(x, low[i], high[i]));
      let best = Infinity, found = null;
      for (let k = 0; k <= iterations; k++) {
        this.setJoints(scratch, q);
        const here = this.poseOf(scratch), off = goal.p.map((x, i) => x - here.p[i]);
        const angle = vector(times(goal.R, transposed(here.R))), size = Math.hypot(...off, ...angle);
        if (norm(off) < CLOSE && norm(angle) < CLOSE_ANGLE && size < best) found = q;
        if (size < 1e-6 || (found && size > 0.98 * best)) return found;
        best = Math.min(best, size);
        mj.mj_jac(model, scratch, ...this.jacobian, here.p, this.body);
        const [places, turns] = this.jacobian.map((buffer) => buffer.GetView());
        const J = [places, turns].flatMap((rows) => [0, 1, 2].map((r) => dofs.map((d) => rows[r * nv + d])));
        const square = J.map((a, i) => J.map((b, j) => a.reduce((sum, x, c) => sum + x * b[c], i === j ? DAMPING : 0)));
        const pull = solve(square, [...off, ...angle]);
        const step = dofs.map((_, c) => J.reduce((sum, row, i) => sum + row[c] * pull[i], 0));
        const scale = Math.min(1, MAX_TURN / Math.max(...step.map(Math.abs), 1e-12));
        q = Array.from({ length: n }, (_, i) => clip(q[i] + scale * step[i], low[i], high[i]));
      }
      return found;
    }

    /** Along a straight line to a pose in the camera's present frame: move_camera. */
    async moveCamera(target) {
      const start = this.cameraPose(), angle = vector(target.R), path = [];
      const n = Math.max(1, Math.ceil(Math.max(norm(target.p) / LINE_STEP, norm(angle) / TURN_STEP)));
      let q = this.joints, blocked = "reached";
      for (let k = 1; k <= n; k++) {
        const way = pose(target.p.map((x) => (x * k) / n), rotation(angle.map((x) => (x * k) / n)));
        const solved = this.inverseKinematics(compose(start, way), q);
        if (!solved || Math.max(...solved.map((x, i) => Math.abs(x - q[i]))) > MAX_JOINT_JUMP) {
          const spare = Math.min(...q.map((x, i) => Math.min(x - this.low[i], this.high[i] - x)));
          blocked = spare < AT_LIMIT ? "joint limit" : "unreachable";
          break;
        }
        path.push(q = solved);
      }
      const moved = await this.follow(path);
      return moved === "reached" ? blocked : moved;
    }

    /** Along a straight line in joint space: move_joints. */
    async moveJoints(goal) {
      const start = this.joints;
      if (goal.some((q, i) => q < this.low[i] || q > this.high[i])) return "joint limit";
      const n = Math.max(1, Math.ceil(Math.max(...goal.map((q, i) => Math.abs(q - start[i]))) / JOINT_STEP));
      return this.follow(Array.from({ length: n }, (_, k) => start.map((q, i) => q + ((goal[i] - q) * (k + 1)) / n)));
    }

    /** About the lens by the last joint alone: rotate_wrist. */
    async rotateWrist(angle) {
      const q = this.joints, nudged = [...q.slice(0, -1), q[q.length - 1] + 1e-3];
      const turned = vector(compose(inverse(this.forward(q)), this.forward(nudged)).R)[2];
      if (Math.abs(turned) <= Math.cos(AT_LIMIT) * 1e-3) return this.moveCamera(turn([0, 0, angle]));
      return this.moveJoints([...q.slice(0, -1), q[q.length - 1] + angle * Math.sign(turned)]);
    }

    async follow(path) {
      if (!path.length) return "reached";
      this.landing = this.noise.landing();
      const truth = path.map((q) => q.map((x, i) => x + this.noise.offset[i] + this.landing[i]));
      return this.dynamic ? this.lead(truth) : this.step(truth);
    }

    async capture() {
      const rgba = this.draw(this);
      this.noise.expose(rgba, this.lens.width, this.lens.height);
      return rgba;
    }

    // --- joints that are simply there: KinematicDrive ---

    put(q) {
      this.data.qvel.fill(0);
      this.setJoints(this.data, q);
      this.mj.mj_collision(this.model, this.data);
    }

    async step(path) {
      for (const q of path) {
        const before = this.truth;
        this.put(q);
        if (this.contacts().some(({ dist, arm }) => arm && dist < 0)) {
          this.put(before);
          return "collision";
        }
        await this.shown(this.seconds(before, q));
      }
      return "reached";
    }

    /** Time between two configurations at the arm's working pace, s. */
    seconds(a, b) { return Math.max(...b.map((q, i) => Math.abs(q - a[i]) / (PACE * this.scene.speeds[i]))); }

    contacts() {
      const { data, ofArm } = this, all = data.contact, found = [];
      for (let i = 0; i < data.ncon; i++) {
        const each = all.get(i), [a, b] = each.geom;
        const { dist, includemargin: margin } = each;
        found.push({ number: i, dist, margin, geoms: [a, b], arm: ofArm[a] || ofArm[b] });
        each.delete();
      }
      all.delete();
      return found;
    }

    // --- servos and contacts: DynamicDrive ---

    /** From now on servos hold the arm, and things can be pushed and lifted. */
    wake() {
      const { mj, model, data } = this;
      if (this.dynamic) return;
      this.dynamic = true;
      this.servos ??= this.scene.servos.map((name) => mj.mj_name2id(model, mj.mjtObj.mjOBJ_ACTUATOR.value, name));
      const { dof_damping: damping, actuator_biasprm: bias, actuator_gainprm: gain } = model;
      const [nb, ng] = [bias.length / model.nu, gain.length / model.nu];
      this.lag = this.servos.map((a, i) => (damping[this.dofs[i]] - bias[nb * a + 2]) / gain[ng * a]);
      this.hold(this.truth);
      mj.mj_forward(model, data);
    }

    hold(q) {
      const ctrl = this.data.ctrl;
      this.servos.forEach((a, i) => { ctrl[a] = q[i]; });
    }

    async lead(path) {
      const knots = [this.servos.map((a) => this.data.ctrl[a]), ...path], step = this.model.opt.timestep, arrival = [0];
      for (let k = 1; k < knots.length; k++) arrival.push(arrival[k - 1] + this.seconds(knots[k - 1], knots[k]));
      const whole = arrival.at(-1), duration = 1.5 * whole, count = Math.ceil(duration / step);
      const at = (time) => {
        let k = arrival.findIndex((each) => each >= time);
        k = clip(k < 0 ? knots.length - 1 : k, 1, knots.length - 1);
        const span = arrival[k] - arrival[k - 1], share = span > 0 ? Math.min(1, (time - arrival[k - 1]) / span) : 1;
        return knots[k].map((q, i) => knots[k - 1][i] + share * (q - knots[k - 1][i]));
      };
      for (let n = 0; n < count; n++) {
        const s = Math.min(1, (n * step) / duration);
        const along = whole * s * s * (3 - 2 * s), speed = (whole * 6 * s * (1 - s)) / duration;
        const [here, ahead] = [at(along), at(along + 1e-3)];
        this.hold(here.map((q, i) => q + speed * 1e3 * this.lag[i] * (ahead[i] - q)));
        if (await this.tick()) return this.protect();
      }
      const goal = knots.at(-1), off = () => Math.max(...this.truth.map((q, i) => Math.abs(q - goal[i])));
      this.hold(goal);
      for (let n = 0; n < 1000; n++) {
        if (await this.tick()) return this.protect();
        const still = Math.max(...this.dofs.map((d) => Math.abs(this.data.qvel[d]))) * 0.01 < SETTLED;
        if (n % 10 === 9 && still && off() < SETTLED) break;
      }
      return off() < ARRIVED ? "reached" : "stalled";
    }

    /** A step of physics; true where something presses on the arm that it does not hold. */
    async tick() {
      this.mj.mj_step(this.model, this.data);
      await this.shown(this.model.opt.timestep);
      const { geom_bodyid: bodies } = this.model;
      return this.data.ncon > 0 && this.contacts().some(({ number, dist, margin, geoms, arm }) => {
        if (!arm || dist >= margin || geoms.some((g) => this.held.has(bodies[g]))) return false;
        this.mj.mj_contactForce(this.model, this.data, number, this.forces);
        return this.forces.GetView()[0] > STOP_FORCE;
      });
    }

    async protect() {
      this.hold(this.truth);
      await this.idle(0.1);
      return "contact";
    }

    async idle(seconds) {
      for (let n = 0; n < seconds / this.model.opt.timestep; n++) await this.tick();
    }

    // --- the gripper: SimulatedGripper ---

    get width() { return this.fingers.reduce((sum, { qpos }) => sum + this.data.qpos[qpos], 0); }

    async fingersTo(width) {
      const { actuator, model } = this, start = this.data.ctrl[actuator];
      for (let k = 1; k <= 70; k++) {
        this.data.ctrl[actuator] = start + ((width - start) * k) / 70;
        await this.idle(0.01);
      }
      await this.idle(0.3);
      const { geom_bodyid: bodies } = model, touched = this.fingers.map(() => new Set());
      for (const { dist, margin, geoms } of this.contacts()) if (dist < margin) this.fingers.forEach(({ body }, f) => {
        const [a, b] = geoms.map((g) => bodies[g]);
        if (a === body) touched[f].add(b);
        if (b === body) touched[f].add(a);
      });
      this.held = new Set([...touched[0]].filter((body) => touched.every((each) => each.has(body))));
    }

    open() { return this.fingersTo(this.scene.gripper.stroke[1]); }
    close() { return this.fingersTo(this.model.actuator_ctrlrange[2 * this.actuator]); }

    /** One reading of the range sensor, m: RangeSensor.read. */
    range() {
      const { mj, model, data, site, rays: { geoms, distances } } = this, R = part(data.site_xmat, site, 9);
      const [s, c] = [Math.sin(CONE), Math.cos(CONE)], around = [0, 1, 2, 3, 4, 5].map((k) => k * Math.PI / 3);
      const cone = [...around.map((angle) => [s * Math.cos(angle), s * Math.sin(angle), c]), [0, 0, 1]];
      const lines = cone.flatMap((ray) => apply(R, ray)), from = part(data.site_xpos, site, 3);
      const own = model.site_bodyid[site];
      mj.mj_multiRay(model, data, from, lines, [1, 1, 1, 0, 0, 0], true, own, geoms, distances, null, 7, 10);
      const hit = [...geoms.GetView()], far = [...distances.GetView()].filter((_, k) => hit[k] >= 0);
      return this.noise.read(far.length ? Math.min(...far) : Infinity);
    }

    // --- what only the judge sees: Truth ---

    /** How far the object has risen, m. */
    get risen() { return this.data.xpos[3 * this.target + 2] - this.lifted; }

    /** Angle between the camera's line of sight and the object's normal, or the nearest of a circle of them, rad:
     * Truth.viewpoint_error. */
    get error() {
      const R = part(this.data.xmat, this.target, 9), sight = column(this.poseOf(this.data).R, 2);
      const { normal, circle } = this.scene;
      if (circle) return Math.abs(Math.asin(clip(dot(apply(R, circle), sight), -1, 1)));
      return Math.acos(clip(-dot(apply(R, normal), sight), -1, 1));
    }
  }

  return { Cell, EpisodeNoise, random };
})();
