// The page: reads its content, fills the panel, and redraws after changes.

const by = (id) => document.getElementById(id);
const scene = JSON.parse(by("scene").textContent);
const data = Object.fromEntries(
  Object.entries(scene.arrays).map(([name, entry]) => [name, decoded(entry)]));
const part = (name, size, i) => Array.from(data[name].subarray(i * size, (i + 1) * size));
const thirds = (numbers) => {
  const rows = [];
  for (let i = 0; i < numbers.length; i += 3) rows.push(numbers.slice(i, i + 3));
  return rows;
};
const grasps = scene.sources.map((source, i) => {
  const corners = thirds(part("boxes", 18, i));
  return {
    row: data.row[i], // of the frame's grasps
    source,
    region: data.grasp_region[i],
    place: data.grasp_place[i],
    rank: data.rank_in_frame[i],
    worth: data.worth_trying[i] > 0,
    slot: data.symmetry_slot[i],
    rotation: part("rotation", 9, i),
    translation: part("translation", 3, i),
    contacts: thirds(part("contacts", 6, i)),
    boxes: [0, 1, 2].map((k) => [corners[2 * k], corners[2 * k + 1]]),
    ...Object.fromEntries(["width", "affordance", "clearance", "enclosed_height", "rank_score"].map(
      (name) => [name, data[name][i]])),
  };
});
// The best of every region first, then the second of every region, and so on.
const inOrder = [...grasps].sort((a, b) => a.place - b.place || a.rank - b.rank);
const hidden = new Set(); // regions
let picked = null;

const colorOf = (grasp) => {
  if (by("by").value === "region") return rgb(scene.regions[grasp.region].color);
  if (by("by").value === "source") return rgb(BY_SOURCE[grasp.source] || GREY);
  return scoreColor(grasp.rank_score);
};
const shownGrasps = () => inOrder.filter(
  (grasp) => grasp.place < Number(by("count").value) && !hidden.has(grasp.region));
const symmetryOf = (grasp) => scene.regions[grasp.region].symmetries.find(
  (each) => each.slot === grasp.slot);

const element = (tag, text, children = []) => {
  const made = document.createElement(tag);
  if (text) made.textContent = text;
  made.append(...children);
  return made;
};

const SLOTS = ["mirror plane 0", "mirror plane 1", "mirror plane 2", "rotation axis",
  "sphere centre"];
const number = (value, digits) => (Number.isFinite(value) ? value.toFixed(digits) : "-");
const millimetres = (value) => `${number(1000 * value, 1)} mm`;
const inSpace = (v, digits) => v.map((value) => number(value, digits)).join("  ");
const named = (each) => `${SLOTS[each.slot]}, confidence ${number(each.confidence, 2)}`;

const writePicked = () => {
  by("picked").hidden = picked === null;
  if (picked === null) return;
  const resting = symmetryOf(picked);
  const facts = [
    ["score", number(picked.rank_score, 4) + (picked.worth ? "" : ", not worth trying")],
    ["rank in frame", `${picked.rank}${picked.rank ? "" : " (try first)"}`],
    ["region", `${picked.region}, its grasp ${picked.place}${picked.place ? "" : " (best)"}`],
    ["source", picked.source],
    ["symmetry", resting ? named(resting) : picked.slot < 0 ? "none" : SLOTS[picked.slot]],
    ["width", millimetres(picked.width)],
    ["opening", millimetres(picked.width + 2 * scene.clearance)],
    ["affordance", number(picked.affordance, 2)],
    ["clearance", millimetres(picked.clearance)],
    ["enclosed", millimetres(picked.enclosed_height)],
    ["translation", `${inSpace(picked.translation, 4)} m`],
    ["approach", inSpace([0, 3, 6].map((k) => picked.rotation[k]), 3)],
  ];
  const rows = facts.flatMap(([name, value]) => [element("dt", name), element("dd", value)]);
  by("picked").replaceChildren(
    element("h2", `grasp ${picked.row}`), element("dl", "", rows));
};

const writeLegend = () => {
  const kind = by("by").value, legend = by("legend");
  const swatch = (color, words) => {
    const made = element("i");
    made.style.background = color;
    return element("span", "", [made, words]);
  };
  if (!grasps.length) legend.replaceChildren();
  else if (kind === "score") {
    const bar = element("b");
    bar.style.background = `linear-gradient(90deg, ${LOW_TO_HIGH.join(", ")})`;
    legend.replaceChildren("0", bar, "1; faint: not worth trying");
  } else if (kind === "source") {
    const sources = [...new Set(scene.sources)].sort();
    legend.replaceChildren(...sources.map((name) => swatch(BY_SOURCE[name] || GREY, name)));
  } else legend.replaceChildren("as the regions below");
};

const makeRegionList = (redraw, look) => {
  scene.regions.forEach((region, index) => {
    const mine = inOrder.filter((grasp) => grasp.region === index);
    const box = element("input"), swatch = element("i"), name = element("button", `region ${index}`);
    Object.assign(box, { type: "checkbox", checked: true, title: "show its grippers" });
    swatch.style.background = region.color;
    box.addEventListener("change", () => {
      if (box.checked) hidden.delete(index);
      else hidden.add(index);
      redraw();
    });
    name.addEventListener("click", () => mine.length && look(mine[0]));
    name.disabled = !mine.length;
    const sure = region.symmetries.filter((each) => each.confidence > 0.5).map(
      (each) => `${SLOTS[each.slot]} ${number(each.confidence, 2)}`);
    const status = region.status === "measured" ? "" : ` ${region.status}`;
    const words = `${region.source}${status} ${number(region.confidence, 2)}, ${mine.length} grasps`
      + (mine.length ? `, best ${number(mine[0].rank_score, 3)}` : "");
    by("regions").append(element("li", "", [box, swatch, name,
      element("small", [words, ...sure].join("; "))]));
  });
  if (!scene.regions.length) by("regions").append(element("li", "none"));
};

const start = (gl, canvas) => {
  const camera = scene.camera, cloud = { depth: data.depth, color: data.color,
    mark: marks(data.region, camera.columns, scene.regions) };
  const { meshes, draw } = makeDrawing(gl, cloud, camera, scene.depth_step);
  let waiting = false;

  const fill = () => {
    const into = { solid: [], lines: [], sheets: [] };
    ownCamera(into, camera);
    const alpha = by("clear").checked ? 0.3 : 1;
    for (const grasp of by("grippers").checked ? shownGrasps() : []) {
      const faint = (picked ? 0.3 : 1) * (grasp.worth ? 1 : 0.3);
      if (grasp !== picked) gripper(into, grasp, colorOf(grasp), faint * alpha);
    }
    const used = picked && symmetryOf(picked);
    if (picked) {
      gripper(into, picked, scale(add(colorOf(picked), rgb(PICKED)), 0.5), alpha);
      contacts(into, picked);
      if (used) symmetry(into, used, scene.up, true);
    }
    const least = Number(by("certainty").value);
    scene.regions.forEach((region, index) => {
      if (!by("symmetries").checked || hidden.has(index)) return;
      if (picked && picked.region !== index) return;
      for (const each of region.symmetries) {
        if (each.confidence >= least && each !== used) symmetry(into, each, scene.up, false);
      }
    });
    for (const name of Object.keys(into)) meshes[name].fill(into[name]);
  };
  const redraw = () => {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      const sharp = window.devicePixelRatio || 1;
      canvas.width = Math.max(1, Math.round(canvas.clientWidth * sharp));
      canvas.height = Math.max(1, Math.round(canvas.clientHeight * sharp));
      draw(orbit.view(), { points: by("points").checked, tint: Number(by("tint").value) });
    });
  };
  const orbit = makeOrbit(canvas, scene, redraw);
  const refresh = () => {
    by("count-shown").textContent = by("count").value;
    by("certainty-shown").textContent = Number(by("certainty").value).toFixed(2);
    writePicked();
    writeLegend();
    fill();
    redraw();
  };
  const pick = (grasp) => {
    picked = grasp;
    refresh();
  };
  const show = (grasp) => { // a grasp picked by list or key
    by("count").value = Math.max(Number(by("count").value), grasp.place + 1);
    orbit.look(grasp.translation);
    pick(grasp);
  };
  makeRegionList(refresh, show);
  controls(canvas, orbit, refresh, pick, show);
  new ResizeObserver(redraw).observe(canvas);
  refresh();
  orbit.go("reset");
};

// The nearest shown gripper on a ray.
const hit = ({ origin, direction }) => {
  let best = null, nearest = Infinity;
  for (const grasp of by("grippers").checked ? shownGrasps() : []) {
    const from = unrotated(grasp.rotation, sub(origin, grasp.translation));
    const along = unrotated(grasp.rotation, direction);
    for (const [low, high] of grasp.boxes) {
      const distance = meetsBox(from, along, low, high);
      if (distance < nearest) [best, nearest] = [grasp, distance];
    }
  }
  return best;
};

const controls = (canvas, orbit, refresh, pick, show) => {
  const most = Math.max(0, ...grasps.map((grasp) => grasp.place + 1));
  Object.assign(by("count"), { max: most, value: Math.min(1, most) });
  for (const id of ["count", "certainty", "tint", "by", "grippers", "clear", "symmetries", "points"]) {
    by(id).addEventListener("input", refresh);
  }
  for (const id of ["reset", "top", "camera"]) {
    by(id).addEventListener("click", () => orbit.go(id));
  }
  canvas.addEventListener("click", (event) => {
    if (!orbit.wasClick()) return;
    const area = canvas.getBoundingClientRect();
    pick(hit(orbit.ray((event.clientX - area.left) / area.width,
      (event.clientY - area.top) / area.height)));
  });
  const toggle = (id) => {
    by(id).checked = !by(id).checked;
    refresh();
  };
  const more = (steps) => {
    by("count").value = Number(by("count").value) + steps;
    refresh();
  };
  const next = () => {
    const choice = shownGrasps();
    if (choice.length) show(choice[(choice.indexOf(picked) + 1) % choice.length]);
  };
  const keys = {
    r: () => orbit.go("reset"), t: () => orbit.go("top"), c: () => orbit.go("camera"),
    g: () => toggle("grippers"), s: () => toggle("symmetries"), p: () => toggle("points"),
    n: next, "+": () => more(1), "=": () => more(1), "-": () => more(-1),
    escape: () => pick(null),
    arrowleft: () => orbit.turn(0.1, 0), arrowright: () => orbit.turn(-0.1, 0),
    arrowup: () => orbit.turn(0, -0.1), arrowdown: () => orbit.turn(0, 0.1),
  };
  document.addEventListener("keydown", (event) => {
    const wanted = keys[event.key.toLowerCase()];
    const typing = ["INPUT", "SELECT"].includes(event.target.tagName)
      && event.key.startsWith("Arrow");
    if (!wanted || typing || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    wanted();
  });
};

const trouble = (words) => {
  by("trouble").textContent = words;
  by("trouble").hidden = false;
};
const canvas = by("view");
const gl = canvas.getContext("webgl2", { antialias: true });
if (!gl) {
  trouble("This browser or its graphics driver has no WebGL 2, which the view needs.");
} else {
  canvas.addEventListener("webglcontextlost", () => trouble("The graphics driver gave up; reload."));
  start(gl, canvas);
}
