// Vectors are arrays of three numbers; matrices are 16 numbers column by column, as in WebGL.

const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const scale = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0],
];
const length = (a) => Math.hypot(a[0], a[1], a[2]);
const unit = (a) => scale(a, 1 / (length(a) || 1));

// The part of a that is perpendicular to the unit vector n.
const across = (a, n) => sub(a, scale(n, dot(a, n)));

// Any unit vector perpendicular to the unit vector n.
const perpendicular = (n) => unit(across(Math.abs(n[0]) < 0.7 ? [1, 0, 0] : [0, 1, 0], n));

// v turned by an angle about the unit vector axis.
const turned = (v, axis, angle) => {
  const c = Math.cos(angle), s = Math.sin(angle);
  return add(add(scale(v, c), scale(cross(axis, v), s)), scale(axis, dot(axis, v) * (1 - c)));
};

// r, 9 numbers row by row, times v; and its transpose times v.
const rotated = (r, v) => [0, 3, 6].map((i) => r[i] * v[0] + r[i + 1] * v[1] + r[i + 2] * v[2]);
const unrotated = (r, v) => [0, 1, 2].map((i) => r[i] * v[0] + r[i + 3] * v[1] + r[i + 6] * v[2]);

const product = (a, b) => {
  const c = new Float32Array(16);
  for (let column = 0; column < 4; column++) {
    for (let row = 0; row < 4; row++) {
      for (let k = 0; k < 4; k++) c[4 * column + row] += a[4 * k + row] * b[4 * column + k];
    }
  }
  return c;
};

// fovy is the whole angle from the lower to the upper edge.
const perspective = (fovy, aspect, near, far) => {
  const f = 1 / Math.tan(fovy / 2), m = new Float32Array(16);
  m[0] = f / aspect;
  m[5] = f;
  m[10] = (far + near) / (near - far);
  m[11] = -1;
  m[14] = (2 * far * near) / (near - far);
  return m;
};

const lookAt = (eye, target, up) => {
  const back = unit(sub(eye, target)), right = unit(cross(up, back)), top = cross(back, right);
  return new Float32Array([
    right[0], top[0], back[0], 0, right[1], top[1], back[1], 0, right[2], top[2], back[2], 0,
    -dot(right, eye), -dot(top, eye), -dot(back, eye), 1,
  ]);
};

// The distance along a ray to the box [low, high]; Infinity if the ray misses the box.
const meetsBox = (origin, direction, low, high) => {
  let near = 0, far = Infinity;
  for (let i = 0; i < 3; i++) {
    const a = (low[i] - origin[i]) / direction[i], b = (high[i] - origin[i]) / direction[i];
    near = Math.max(near, Math.min(a, b));
    far = Math.min(far, Math.max(a, b));
  }
  return near <= far ? near : Infinity;
};
