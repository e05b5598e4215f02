"use strict";
// Pictures of the cell: the overview with light and shadow, and what the camera in the hand sees, lit as MuJoCo lights
// it. The bodies are the scene graph's own JSON, parsed twice; no shape is made here.
const pictures = (() => {
  const { THREE } = MeshCat;
  const SHADOWS = 1024, SLOW = 0.6;  // px; of a pixel's side, where a processor draws

  /** Whether this browser draws with its processor; null where it does not draw at all. */
  function drawsInSoftware() {
    const context = document.createElement("canvas").getContext("webgl");
    if (!context) return null;
    const named = context.getExtension("WEBGL_debug_renderer_info");
    const renderer = named ? context.getParameter(named.UNMASKED_RENDERER_WEBGL) : "";
    return /swiftshader|llvmpipe|software|basic render/i.test(renderer);
  }

  /** An object of three.js' JSON, its textures there. */
  async function parsed(json) {
    let ready;
    const loaded = new Promise((done) => { ready = done; });
    const object = new THREE.ObjectLoader().parse(json, ready);
    if (json.images?.length) await loaded;
    return object;
  }

  /** The same materials, lit alike wherever one looks from: what MuJoCo's are without highlights. */
  function dull(json, type) {
    const copy = structuredClone(json);
    for (const material of copy.materials ?? []) if (material.type === "MeshStandardMaterial") {
      Object.assign(material, { type, ...(type === "MeshPhongMaterial" ? { specular: 0, shininess: 1 } : {}) });
      delete material.roughness;
      delete material.metalness;
    }
    return copy;
  }

  class Pictures {
    constructor(canvas) {
      this.software = drawsInSoftware();
      if (this.software === null) throw new Error("This browser cannot draw 3D (WebGL is off).");
      this.canvas = canvas;
      this.renderer = new THREE.WebGLRenderer({ canvas, antialias: !this.software, alpha: true });
      this.renderer.shadowMap.enabled = !this.software;
      this.renderer.shadowMap.type = THREE.PCFSoftShadowMap;
      this.eye = new THREE.PerspectiveCamera(35, 1.5, 0.01, 30);
      this.eye.up.set(0, 0, 1);
      this.hand = new THREE.PerspectiveCamera();
      this.hand.matrixAutoUpdate = false;
    }

    /** Take up a scene. */
    async show({ objects, lens, view, lights }) {
      Object.assign(this, { lens, overview: new THREE.Scene(), seen: new THREE.Scene(), bodies: new Map() });
      for (const { path, object } of objects) {
        const pair = [await parsed(this.software ? dull(object, "MeshLambertMaterial") : object),
          await parsed(dull(object, this.software ? "MeshLambertMaterial" : "MeshPhongMaterial"))];
        pair[0].traverse((each) => { each.castShadow = each.receiveShadow = !this.software; });
        for (const each of pair) each.matrixAutoUpdate = false;
        this.overview.add(pair[0]);
        this.seen.add(pair[1]);
        this.bodies.set(Number(path.split("/")[2]), pair);
      }
      this.lightSeen(lights);
      this.lightOverview(view);
      this.target?.dispose();
      this.target = new THREE.WebGLRenderTarget(lens.width, lens.height,
        { minFilter: THREE.NearestFilter, magFilter: THREE.NearestFilter });
      this.rows = new Uint8Array(4 * lens.width * lens.height);
      this.rgba = new Uint8Array(this.rows.length);
      this.focus(1);
      this.home = () => {
        this.eye.fov = view.fovy;
        this.lookat = new THREE.Vector3(...view.lookat);
        this.eye.position.set(...view.eye);
        this.fit();
      };
      this.home();
    }

    lightSeen({ ambient, head, lamps }) {
      this.seen.add(new THREE.AmbientLight(new THREE.Color(...ambient), 1));
      this.head = new THREE.DirectionalLight(new THREE.Color(...head), 1);
      this.seen.add(this.head, this.head.target);
      for (const { pos, diffuse } of lamps) {
        const lamp = new THREE.PointLight(new THREE.Color(...diffuse), 1, 0, 0);
        lamp.position.set(...pos);
        this.seen.add(lamp);
      }
    }

    lightOverview({ lookat: [x, y, z], extent }) {  // as scene.js has it
      const sky = new THREE.HemisphereLight(0xffffff, 0xcfc4b4, 0.56);
      const key = new THREE.DirectionalLight(0xfff4e6, 0.44), fill = new THREE.DirectionalLight(0xe6eeff, 0.16);
      sky.position.set(0, 0, 1);
      key.position.set(x + 1.2 * extent, y - 0.9 * extent, z + 2.4 * extent);
      fill.position.set(x - 2 * extent, y + 1.5 * extent, z + extent);
      for (const light of [key, fill]) light.target.position.set(x, y, z);
      key.castShadow = true;
      Object.assign(key.shadow, { bias: -0.0004, normalBias: 0.004, radius: 3 });
      key.shadow.mapSize.set(SHADOWS, SHADOWS);
      const side = 1.1 * extent;
      Object.assign(key.shadow.camera, { left: -side, right: side, top: side, bottom: -side });
      Object.assign(key.shadow.camera, { near: 0.05 * extent, far: 6 * extent });
      this.overview.add(sky, key, fill, key.target, fill.target, this.frustum = frustum(this.lens));
    }

    /** The true lens: the stated one's focal length, so many times. */
    focus(scale) {
      const { fx, fy, cx, cy, width, height } = this.lens, [near, far] = [0.005, 10];
      // Pixel centers are whole numbers, so that the image's border lies half a pixel outside.
      const [l, r] = [-(cx + 0.5), width - 0.5 - cx].map((x) => (near * x) / (scale * fx));
      const [t, b] = [cy + 0.5, cy + 0.5 - height].map((y) => (near * y) / (scale * fy));
      this.hand.projectionMatrix.makePerspective(l, r, t, b, near, far);
      this.hand.projectionMatrixInverse.copy(this.hand.projectionMatrix).invert();
    }

    place({ data, camera }) {
      const { xpos, xmat, cam_xpos: at, cam_xmat: turned } = data;
      const put = (object, p, i, R, j) => {
        const rows = [0, 1, 2].flatMap((r) => [R[j + 3 * r], R[j + 3 * r + 1], R[j + 3 * r + 2], p[i + r]]);
        object.matrix.set(...rows, 0, 0, 0, 1);
        object.matrixWorldNeedsUpdate = true;
      };
      for (const [body, pair] of this.bodies) if (body) {
        for (const each of pair) put(each, xpos, 3 * body, xmat, 9 * body);
      }
      put(this.hand, at, 3 * camera, turned, 9 * camera);
      put(this.frustum, at, 3 * camera, turned, 9 * camera);
      this.hand.updateMatrixWorld(true);
      const [i, j] = [3 * camera, 9 * camera];  // the headlight shines along the view
      this.head.position.set(at[i], at[i + 1], at[i + 2]);
      this.head.target.position.set(at[i] - turned[j + 2], at[i + 1] - turned[j + 5], at[i + 2] - turned[j + 8]);
    }

    /** What the camera in the hand sees: RGBA, row by row from the top. */
    capture(cell) {
      const { renderer, target, rows, rgba, lens: { width, height } } = this;
      this.place(cell);
      renderer.setRenderTarget(target);
      renderer.render(this.seen, this.hand);
      renderer.readRenderTargetPixels(target, 0, 0, width, height, rows);
      renderer.setRenderTarget(null);
      const row = 4 * width;  // WebGL counts them from the bottom
      for (let y = 0; y < height; y++) rgba.set(rows.subarray(row * (height - 1 - y), row * (height - y)), row * y);
      return rgba;
    }

    /** The overview, from where the reader looks. */
    draw(cell) {
      this.place(cell);
      this.renderer.render(this.overview, this.eye);
    }

    fit() {
      const { width, height } = this.canvas.getBoundingClientRect();
      const scale = this.software ? SLOW : Math.min(2, devicePixelRatio);
      this.renderer.setSize(Math.max(1, width * scale), Math.max(1, height * scale), false);
      this.eye.aspect = width / Math.max(1, height);
      this.eye.updateProjectionMatrix();
      this.eye.lookAt(this.lookat);
    }

    /** The sphere over which the camera flies; null: none. */
    showSphere(sphere) {
      if (this.sphere) this.overview.remove(this.sphere);
      this.sphere = null;
      if (!sphere) return;
      const glass = { color: 0x56b4e9, transparent: true, opacity: 0.16, depthWrite: false };
      this.sphere = new THREE.Mesh(new THREE.SphereGeometry(sphere.radius, 48, 32), new THREE.MeshBasicMaterial(glass));
      this.sphere.position.set(...sphere.center);
      this.overview.add(this.sphere);
    }

    /** Direction from the sphere's center to where a reader points at it; null where that is beside it. */
    pointed({ clientX, clientY }) {
      const { left, top, width, height } = this.canvas.getBoundingClientRect(), ray = new THREE.Raycaster();
      ray.setFromCamera({ x: (2 * (clientX - left)) / width - 1, y: 1 - (2 * (clientY - top)) / height }, this.eye);
      const [hit] = this.sphere ? ray.intersectObject(this.sphere) : [];
      return hit ? hit.point.sub(this.sphere.position).normalize().toArray() : null;
    }

    /** Turn the reader's eye about the scene, by angles, rad, or come nearer. */
    orbit(across, up, nearer = 1) {
      const from = this.eye.position.clone().sub(this.lookat).multiplyScalar(nearer);
      const sphere = new THREE.Spherical().setFromVector3(new THREE.Vector3(from.x, from.z, -from.y));
      sphere.theta -= across;
      sphere.phi = Math.min(3, Math.max(0.1, sphere.phi - up));
      const to = new THREE.Vector3().setFromSpherical(sphere);
      this.eye.position.set(to.x, -to.z, to.y).add(this.lookat);
      this.eye.lookAt(this.lookat);
    }
  }

  /** What the camera sees, as a pyramid of lines. */
  function frustum({ fx, fy, width, height }, depth = 0.12) {
    const [a, b] = [(0.5 * depth * width) / fx, (0.5 * depth * height) / fy];
    const corners = [[-a, b], [a, b], [a, -b], [-a, -b]].map(([x, y]) => [x, y, -depth]);
    const points = corners.flatMap((corner, k) => [0, 0, 0, ...corner, ...corner, ...corners[(k + 1) % 4]]);
    const lines = new THREE.BufferGeometry();
    lines.setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
    const object = new THREE.LineSegments(lines, new THREE.LineBasicMaterial({ color: 0xe69f00 }));
    object.matrixAutoUpdate = false;
    return object;
  }

  return { Pictures, drawsInSoftware };
})();
