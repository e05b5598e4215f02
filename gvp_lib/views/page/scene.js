"use strict";
// The player of one 3D scene. meshcat draws it; here are the light, the camera, the play bar and the live socket.
(() => {
  const { Viewer, THREE } = MeshCat;
  const payload = JSON.parse(document.getElementById("payload").textContent);
  const pane = document.getElementById("view"), message = document.getElementById("message");
  let viewer;
  try {
    viewer = new Viewer(pane);
  } catch (error) {
    message.textContent = "This browser cannot draw 3D (WebGL is off).";
    message.hidden = false;
    parent.postMessage({ gvpScene: "failed" }, "*");
    return;
  }
  const toPage = ([x, y, z]) => new THREE.Vector3(x, z, -y);  // the page's y is the world's z

  // --- light: a soft sky, a key light with shadows, and no grid or axes -------------------------------------
  for (const path of [["Grid"], ["Axes"], ["Lights", "SpotLight"], ["Lights", "PointLightNegativeX"],
    ["Lights", "PointLightPositiveX"], ["Lights", "FillLight"], ["Lights", "AmbientLight"]]) viewer.delete_path(path);
  const { lookat, extent } = payload.view;
  const sky = new THREE.HemisphereLight(0xffffff, 0xcfc4b4, 0.56);
  sky.position.set(0, 0, 1);
  const key = new THREE.DirectionalLight(0xfff4e6, 0.44), fill = new THREE.DirectionalLight(0xe6eeff, 0.16);
  key.position.set(lookat[0] + 1.2 * extent, lookat[1] - 0.9 * extent, lookat[2] + 2.4 * extent);
  key.target.position.set(...lookat);
  key.castShadow = true;
  Object.assign(key.shadow, { bias: -0.0004, normalBias: 0.004, radius: 3 });
  key.shadow.mapSize.set(2048, 2048);
  Object.assign(key.shadow.camera, { left: -1.1 * extent, right: 1.1 * extent, top: 1.1 * extent,
    bottom: -1.1 * extent, near: 0.05 * extent, far: 6 * extent });
  fill.position.set(lookat[0] - 2 * extent, lookat[1] + 1.5 * extent, lookat[2] + extent);
  fill.target.position.set(...lookat);
  viewer.set_object(["Lights", "Sky"], sky);
  viewer.set_object(["Lights", "Key"], key);
  viewer.set_object(["Lights", "Fill"], fill);
  viewer.scene.add(key.target, fill.target);

  // --- theme: the embedding page's, else the reader's ---------------------------------------------------------
  const prefersDark = matchMedia("(prefers-color-scheme: dark)");
  let told = { "#dark": "dark", "#light": "light" }[location.hash];
  const paint = () => {
    document.documentElement.classList.toggle("dark", told ? told === "dark" : prefersDark.matches);
    const dark = document.documentElement.classList.contains("dark");
    sky.intensity = dark ? 0.4 : 0.56;  // a bright floor would glare in a dark page
    key.intensity = dark ? 0.38 : 0.44;
    viewer.hide_background();  // the page's own gradient shows through
    const style = getComputedStyle(document.documentElement);
    const haze = new THREE.Color(style.getPropertyValue("--bottom").trim()).lerp(
      new THREE.Color(style.getPropertyValue("--top").trim()), 0.5);
    viewer.scene.fog = new THREE.Fog(haze, 3.2 * extent, 9 * extent);  // a floor without end fades out
    viewer.set_dirty();
  };
  prefersDark.addEventListener("change", paint);
  addEventListener("message", (event) => {
    if (event.data && ["dark", "light"].includes(event.data.gvpTheme)) { told = event.data.gvpTheme; paint(); }
  });

  // --- camera -------------------------------------------------------------------------------------------------
  viewer.camera.fov = payload.view.fovy;
  viewer.camera.near = 0.01 * extent;
  viewer.controls.minDistance = 0.1 * extent;
  viewer.controls.maxDistance = 8 * extent;
  const home = () => {
    viewer.controls.target.copy(toPage(lookat));
    viewer.camera.position.copy(toPage(payload.view.eye));
    // A view wider than it is high was framed for; in a narrow one, step back.
    const narrow = Math.max(1, 1.25 / (innerWidth / Math.max(1, innerHeight)));
    viewer.camera.position.sub(viewer.controls.target).multiplyScalar(narrow).add(viewer.controls.target);
    viewer.controls.update();
    viewer.set_dirty();
  };
  document.getElementById("home").addEventListener("click", home);
  // A wheel turned over the view scrolls the book, until the reader has taken hold of the view.
  const framed = parent !== window;
  viewer.controls.enableZoom = !framed;
  pane.addEventListener("pointerdown", () => { viewer.controls.enableZoom = true; pane.focus({ preventScroll: true }); });
  pane.addEventListener("pointerleave", (event) => { if (!event.buttons) viewer.controls.enableZoom = !framed; });
  // So does a swipe, until a tap has taken hold of the view; a tap beside it lets go.
  const root = document.documentElement;
  const hold = (held) => root.classList.toggle("held", held || !framed);
  pane.addEventListener("pointerdown", (event) => {
    viewer.controls.enabled = event.pointerType === "mouse" || root.classList.contains("held");
  }, { capture: true });  // before the controls hear of it
  pane.addEventListener("click", (event) => { if (event.pointerType !== "mouse") hold(true); });
  addEventListener("blur", () => hold(false));
  addEventListener("message", (event) => { if (event.data?.gvpScene === "release") hold(false); });
  root.classList.toggle("framed", framed);
  hold(false);
  const orbit = new THREE.Spherical();
  const turn = (azimuth, polar, zoom) => {
    const offset = viewer.camera.position.clone().sub(viewer.controls.target);
    orbit.setFromVector3(offset);
    orbit.theta += azimuth;
    orbit.phi = Math.min(Math.PI - 0.05, Math.max(0.05, orbit.phi + polar));
    orbit.radius *= zoom;
    viewer.camera.position.copy(viewer.controls.target).add(offset.setFromSpherical(orbit));
    viewer.set_dirty();
  };

  // --- scene and live updates ------------------------------------------------------------------------------
  const split = (path) => path.split("/").filter(Boolean);
  const apply = (command) => {
    if (command.type === "pose") {
      const object = viewer.scene_tree.find(split(command.path)).object, p = command.pose;
      object.position.set(p[0], p[1], p[2]);
      object.quaternion.set(p[3], p[4], p[5], p[6]);
      viewer.set_dirty();
    } else {
      viewer.handle_command(command);
    }
  };
  payload.commands.forEach(apply);
  const connect = () => {
    const address = new URL("socket", location.href);
    address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    address.hash = "";
    const socket = new WebSocket(address);
    let heard = false;
    socket.onmessage = (event) => { heard = true; message.hidden = true; JSON.parse(event.data).forEach(apply); };
    socket.onclose = () => {
      message.textContent = "The notebook's kernel has stopped; this is the scene's last state.";
      message.hidden = false;
      if (heard) setTimeout(connect, 2000);
    };
  };
  if (payload.live) connect();

  // --- recording ----------------------------------------------------------------------------------------------
  const summed = (deltas, width, step) => {
    const values = new Array(deltas.length), last = new Array(width).fill(0);
    deltas.forEach((d, i) => { values[i] = (last[i % width] += d) * step; });
    return values;
  };
  const film = payload.animation;
  if (film && film.tracks.length && film.times.length > 1) {
    const times = film.times.map((ms) => ms / 1000), duration = times[times.length - 1];
    viewer.set_animation(film.tracks.map((track) => ({
      path: split(track.path),
      clip: { name: "recording", fps: 1, tracks: [
        ...(track.p ? [{ name: ".position", type: "vector3", times, values: summed(track.p, 3, film.steps[0]) }] : []),
        ...(track.q ? [{ name: ".quaternion", type: "quaternion", times, values: summed(track.q, 4, film.steps[1]) }] : []),
      ] },
    })), { play: false, repetitions: Infinity });
    const animator = viewer.animator, bar = document.getElementById("bar"), button = document.getElementById("play");
    const scrub = document.getElementById("scrub"), clock = document.getElementById("time");
    const icons = { play: "M8 5v14l11-7z", pause: "M7 5h4v14H7zm6 0h4v14h-4z" };
    let wanted = !matchMedia("(prefers-reduced-motion: reduce)").matches, seen = false;
    const show = (time) => {
      scrub.value = time;
      scrub.setAttribute("aria-valuetext", `${time.toFixed(1)} of ${duration.toFixed(1)} seconds`);
      clock.textContent = `${time.toFixed(1)} / ${duration.toFixed(1)} s`;
    };
    const seek = (time) => { animator.seek(time); animator.time = time; show(time); };
    const settle = () => {
      const run = wanted && seen && !document.hidden;
      if (run && !animator.playing) animator.play();
      if (!run && animator.playing) animator.pause();
      button.setAttribute("aria-label", wanted ? "Pause" : "Play");
      button.querySelector("path").setAttribute("d", wanted ? icons.pause : icons.play);
    };
    const toggle = () => { wanted = !wanted; settle(); };
    animator.play();  // arms the actions, so that seeking works before the first play
    animator.pause();
    scrub.max = duration;
    seek(0);
    button.addEventListener("click", toggle);
    scrub.addEventListener("input", () => { wanted = false; settle(); seek(Number(scrub.value)); });
    pane.addEventListener("keydown", (event) => { if (event.key === " ") { event.preventDefault(); toggle(); } });
    document.addEventListener("visibilitychange", settle);
    new IntersectionObserver(([entry]) => { seen = entry.isIntersecting; settle(); }, { threshold: 0.25 }).observe(pane);
    const follow = () => { if (animator.playing) show(animator.time); requestAnimationFrame(follow); };
    requestAnimationFrame(follow);
    bar.hidden = false;
    // The bar covers the lower edge: move the picture's middle up by half of it.
    const shift = () => viewer.camera.setViewOffset(innerWidth, innerHeight, 0, 28, innerWidth, innerHeight);
    addEventListener("resize", shift);
    shift();
  }
  pane.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [-0.1, 0, 1], ArrowRight: [0.1, 0, 1], ArrowUp: [0, -0.1, 1], ArrowDown: [0, 0.1, 1],
      "+": [0, 0, 0.9], "=": [0, 0, 0.9], "-": [0, 0, 1 / 0.9] }[event.key];
    if (step) { event.preventDefault(); turn(...step); } else if (event.key === "Home") home();
  });
  paint();
  home();
  window.gvpScene = viewer;  // for whoever opens the console
  parent.postMessage({ gvpScene: "ready" }, "*");
})();
