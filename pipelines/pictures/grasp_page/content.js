// Grippers, symmetries and the camera as triangles and lines in the camera frame.

// The colours of palette.py.
const LOW_TO_HIGH = ["#8a929c", "#a3b07d", "#b4d25f", "#7ee95c", "#3cff5a"]; // scores 0 to 1
const BY_SOURCE = { network: "#3cff5a", planar: "#ffa01e", random: "#bebebe", "gg-cnn": "#00b39f", "multi-grasp": "#b07a5a", pointnetgpd: "#ff6e5a", graspnet: "#e05a9b" };
const PLANES = ["#ff50c8", "#5a82ff", "#ffbe28"]; // mirror planes 0, 1, 2
const AXIS = "#ff3c3c";
const PICKED = "#ffffff";
const CONTACT = "#ff2828";
const GREY = "#8a929c";
const ROUND = 32; // sides of a circle

const rgb = (text) => [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16) / 255);

// The colour of a score 0..1.
const scoreColor = (score) => {
  const at = Math.min(Math.max(score, 0), 1) * (LOW_TO_HIGH.length - 1);
  const low = Math.min(Math.floor(at), LOW_TO_HIGH.length - 2), part = at - low;
  const [a, b] = [rgb(LOW_TO_HIGH[low]), rgb(LOW_TO_HIGH[low + 1])];
  return a.map((value, i) => value * (1 - part) + b[i] * part);
};

const decoded = (entry) => {
  const text = atob(entry.data), bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  const kinds = { "<u2": Uint16Array, "|u1": Uint8Array, "<i4": Int32Array, "<f4": Float32Array };
  return new kinds[entry.dtype](bytes.buffer);
};

// The colour of each pixel's region, and whether it is on the region's outline.
const marks = (region, columns, regions) => {
  const mark = new Uint8Array(4 * region.length);
  const colors = regions.map((each) => rgb(each.color).map((value) => 255 * value));
  for (let i = 0; i < region.length; i++) {
    const label = region[i];
    if (!label) continue;
    const inner = [i - 1, i + 1, i - columns, i + columns].every((near) => region[near] === label);
    mark.set(colors[label - 1], 4 * i);
    mark[4 * i + 3] = inner ? 128 : 255;
  }
  return mark;
};

const triangle = (into, a, b, c, color, alpha, normal) => {
  const n = normal || unit(cross(sub(b, a), sub(c, a)));
  for (const p of [a, b, c]) into.push(...p, ...n, ...color, alpha);
};
const quad = (into, [a, b, c, d], color, alpha) => {
  triangle(into, a, b, c, color, alpha);
  triangle(into, a, c, d, color, alpha);
};
const line = (into, a, b, color) => {
  for (const p of [a, b]) into.push(...p, 0, 0, 0, ...color, 1);
};

const FACES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
const EDGES = [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5],
  [2, 6], [3, 7]];

const box = (into, low, high, toCamera, color, alpha) => {
  const corners = [...Array(8).keys()].map((k) => toCamera([
    (k & 4 ? high : low)[0], (k & 2 ? high : low)[1], (k & 1 ? high : low)[2],
  ]));
  const body = alpha < 1 ? into.sheets : into.solid, edge = scale(color, alpha < 1 ? 1 : 0.55);
  for (const face of FACES) quad(body, face.map((k) => corners[k]), color, alpha);
  for (const [a, b] of EDGES) line(into.lines, corners[a], corners[b], edge);
};

// A rod from a to b.
const rod = (into, a, b, radius, color) => {
  const along = unit(sub(b, a)), first = scale(perpendicular(along), radius);
  for (let k = 0; k < 8; k++) {
    const [p, q] = [k, k + 1].map((j) => turned(first, along, (j * Math.PI) / 4));
    quad(into.solid, [add(a, p), add(a, q), add(b, q), add(b, p)], color, 1);
  }
};

const ball = (into, place, radius, color) => {
  const at = (i, j) => {
    const up = (i * Math.PI) / 6, round = (j * Math.PI) / 5;
    const level = Math.sin(up) * radius;
    return add(place, [level * Math.cos(round), level * Math.sin(round), Math.cos(up) * radius]);
  };
  for (let i = 0; i < 6; i++) {
    for (let j = 0; j < 10; j++) {
      quad(into, [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)], color, 1);
    }
  }
};

const gripper = (into, grasp, color, alpha) => {
  const toCamera = (p) => add(rotated(grasp.rotation, p), grasp.translation);
  for (const [low, high] of grasp.boxes) box(into, low, high, toCamera, color, alpha);
};

const contacts = (into, grasp) => {
  for (const place of grasp.contacts) ball(into.solid, place, 0.004, rgb(CONTACT));
  line(into.lines, ...grasp.contacts, rgb(CONTACT));
};

// Sheets are level with respect to `up`.
const symmetry = (into, each, up, strong) => {
  const place = each.place, alpha = (strong ? 0.4 : 0.22) * Math.max(each.confidence, 0.3);
  if (each.kind === "axis") {
    const half = scale(each.direction, 1.4 * each.radius);
    rod(into, sub(place, half), add(place, half), strong ? 0.003 : 0.0018, rgb(AXIS));
    return;
  }
  const normals = each.kind === "sphere" ? [[1, 0, 0], [0, 1, 0], [0, 0, 1]] : [];
  for (const normal of normals) {
    const first = scale(perpendicular(normal), each.radius);
    for (let k = 0; k < ROUND; k++) {
      const [a, b] = [k, k + 1].map((j) => turned(first, normal, (2 * Math.PI * j) / ROUND));
      line(into.lines, add(place, a), add(place, b), rgb(AXIS));
    }
  }
  if (each.kind === "sphere") {
    ball(into.solid, place, 0.005, rgb(AXIS));
    return;
  }
  const color = rgb(PLANES[each.slot]), first = across(up, each.direction);
  const u = length(first) > 0.1 ? unit(first) : perpendicular(each.direction);
  const v = cross(each.direction, u), size = 0.9 * each.radius;
  const corners = [[-1, -1], [-1, 1], [1, 1], [1, -1]].map(([a, b]) =>
    add(place, add(scale(u, a * size), scale(v, b * size))));
  quad(into.sheets, corners, color, alpha);
  corners.forEach((corner, k) => line(into.lines, corner, corners[(k + 1) % 4], color));
};

// The camera: its axes x red, y green, z blue, and the corners of its picture at 3 cm.
const ownCamera = (into, camera) => {
  ["#ff5555", "#55dd55", "#5588ff"].forEach((color, i) => {
    line(into.lines, [0, 0, 0], [0, 1, 2].map((k) => (k === i ? 0.02 : 0)), rgb(color));
  });
  const corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(([u, v]) => scale([
    (u * camera.columns - camera.cx) / camera.fx, (v * camera.rows - camera.cy) / camera.fy, 1,
  ], 0.03));
  corners.forEach((corner, k) => {
    line(into.lines, corner, corners[(k + 1) % 4], rgb(GREY));
    line(into.lines, [0, 0, 0], corner, rgb(GREY));
  });
};
