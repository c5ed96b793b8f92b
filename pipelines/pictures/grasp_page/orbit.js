// The eye: its position, and its motion by pointers and keys.

const FOV = (50 * Math.PI) / 180;
const NEAR = 0.01, FAR = 60;
const SLANT = 0.8, ASIDE = 0.35; // radians: least tilt from straight down, angle to the camera

// The views of keys and buttons; `scene` gives the place of the objects and the upward direction.
const standardViews = (scene) => {
  const { place, radius } = scene.focus, up = scene.up, camera = scene.camera;
  const distance = 2.5 * radius, level = across([0, 0, 1], up), below = across([0, 1, 0], up);
  const seen = unit(scale(place, -1)), away = across(seen, up); // from the objects to the camera
  // If the camera looks straight down, the upper side of its picture is ahead.
  const ahead = length(level) > 0.3 ? unit(level) : unit(scale(below, -1));
  const flat = length(away) > 0.3 ? unit(away) : unit(below);
  // From the optical axis to the farther edges of the picture: half a pixel past the outer centers.
  const high = Math.max(camera.cy + 0.5, camera.rows - 0.5 - camera.cy) / camera.fy;
  const wide = Math.max(camera.cx + 0.5, camera.columns - 0.5 - camera.cx) / camera.fx;
  const steep = Math.max(Math.atan2(length(away), dot(seen, up)), SLANT);
  const aside = turned(add(scale(up, Math.cos(steep)), scale(flat, Math.sin(steep))), up, ASIDE);
  return {
    reset: () => ({ eye: add(place, scale(aside, distance)), target: place, up, fovy: FOV }),
    top: () => ({ eye: add(place, scale(up, distance)), target: place, up: ahead, fovy: FOV }),
    camera: (aspect) => ({
      eye: [0, 0, 0],
      target: [0, 0, length(place)],
      up: [0, -1, 0],
      // The whole picture is visible, with a margin if the window has another shape.
      fovy: 2 * Math.atan(Math.max(high, wide / aspect)),
    }),
  };
};

const makeOrbit = (canvas, scene, changed) => {
  const views = standardViews(scene), fingers = new Map();
  let state = null, name = "reset", moved = 0;

  const aspect = () => canvas.clientWidth / Math.max(canvas.clientHeight, 1);
  const go = (wanted) => {
    name = wanted;
    state = views[wanted](aspect());
    changed();
  };
  const leaveView = () => { // the view is no standard view any more
    name = "";
    changed();
  };
  const frame = () => {
    const ahead = unit(sub(state.target, state.eye)), right = unit(cross(ahead, state.up));
    return { ahead, right, top: cross(right, ahead) };
  };
  const turn = (dx, dy) => {
    const { right, top } = frame(), both = (v) => turned(turned(v, right, dy), scene.up, dx);
    state.eye = add(state.target, both(sub(state.eye, state.target)));
    state.up = unit(both(top));
    leaveView();
  };
  const shift = (dx, dy) => {
    const { right, top } = frame(), far = length(sub(state.target, state.eye));
    const metres = (2 * far * Math.tan(state.fovy / 2)) / canvas.clientHeight;
    const step = add(scale(right, -dx * metres), scale(top, dy * metres));
    state.eye = add(state.eye, step);
    state.target = add(state.target, step);
    leaveView();
  };
  const zoom = (factor) => {
    const away = sub(state.eye, state.target), far = length(away);
    const wanted = Math.min(Math.max(far * factor, 0.03), 20);
    state.eye = add(state.target, scale(away, wanted / far));
    leaveView();
  };

  canvas.addEventListener("pointerdown", (event) => {
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    try {
      canvas.setPointerCapture(event.pointerId);
    } catch { /* the pointer is gone, or was synthetic */ }
    moved = fingers.size > 1 ? Infinity : 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY], dx = now[0] - before[0], dy = now[1] - before[1];
    moved += Math.abs(dx) + Math.abs(dy);
    if (fingers.size === 2) {
      const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
      const gap = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
      zoom(gap(before) / gap(now));
      shift(dx / 2, dy / 2);
    } else if (event.buttons & 6 || event.shiftKey) shift(dx, dy);
    else turn(-dx * 0.006, -dy * 0.006);
    fingers.set(event.pointerId, now);
  });
  for (const kind of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(kind, (event) => fingers.delete(event.pointerId));
  }
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 30 : 1;
    zoom(Math.exp(Math.min(Math.max(event.deltaY * lines, -200), 200) * 0.002));
  }, { passive: false });

  // The matrices of the shaders; the camera's view fits any shape of the window.
  const view = () => {
    if (name === "camera") state.fovy = views.camera(aspect()).fovy;
    const clip = product(
      perspective(state.fovy, aspect(), NEAR, FAR), lookAt(state.eye, state.target, state.up));
    const half = Math.tan(state.fovy / 2);
    return { clip, eye: state.eye, pixelsAtOneMetre: canvas.height / (2 * half) };
  };
  // The ray from the eye through a place on the canvas, 0..1 from its upper left corner.
  const ray = (x, y) => {
    const { ahead, right, top } = frame(), half = Math.tan(state.fovy / 2);
    const sideways = scale(right, (2 * x - 1) * half * aspect());
    return { origin: state.eye, direction: add(add(ahead, sideways),
      scale(top, (1 - 2 * y) * half)) };
  };
  const look = (place) => {
    const away = sub(state.eye, state.target);
    state.target = place;
    state.eye = add(place, away);
    leaveView();
  };
  return { go, turn, zoom, view, ray, look, wasClick: () => moved < 5 };
};
