// WebGL: a cloud of pixels, lit triangles, and lines.

const POINTS_VERTEX = `#version 300 es
layout(location = 0) in uint depth;
layout(location = 1) in vec3 color;
layout(location = 2) in vec4 mark;  // a: 0 no region, 0.5 in one, 1 on its outline
uniform mat4 clip;
uniform vec4 camera;  // fx fy cx cy
uniform float depthStep, size, tint;
uniform int columns;
out vec3 shade;
void main() {
  float z = float(depth) * depthStep;
  vec2 pixel = vec2(gl_VertexID % columns, gl_VertexID / columns);
  gl_Position = clip * vec4((pixel - camera.zw) / camera.xy * z, z, 1.0);
  gl_PointSize = clamp(size * z / gl_Position.w, 1.0, 40.0);
  if (depth == 0u) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  float share = mark.a > 0.75 ? (tint > 0.0 ? 0.9 : 0.0) : mark.a > 0.25 ? tint : 0.0;
  shade = mix(color, mark.rgb, share);
}`;
const POINTS_FRAGMENT = `#version 300 es
precision mediump float;
in vec3 shade;
out vec4 result;
void main() { result = vec4(shade, 1.0); }`;
const MESH_VERTEX = `#version 300 es
layout(location = 0) in vec3 place;
layout(location = 1) in vec3 normal;  // zero for unlit lines
layout(location = 2) in vec4 color;
uniform mat4 clip;
uniform vec3 eye;
out vec4 shade;
void main() {
  gl_Position = clip * vec4(place, 1.0);
  float facing = abs(dot(normal, normalize(eye - place)));
  shade = vec4(color.rgb * (dot(normal, normal) > 0.0 ? 0.45 + 0.55 * facing : 1.0), color.a);
}`;
const MESH_FRAGMENT = `#version 300 es
precision mediump float;
in vec4 shade;
out vec4 result;
void main() { result = shade; }`;

const compiled = (gl, vertex, fragment) => {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
      throw new Error(gl.getShaderInfoLog(shader));
    }
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  const found = { program };
  for (const name of ["clip", "camera", "depthStep", "size", "tint", "columns", "eye"]) {
    found[name] = gl.getUniformLocation(program, name);
  }
  return found;
};

// A cloud's attributes in a vertex array; depth Uint16, color Uint8 x 3, mark Uint8 x 4.
const loadCloud = (gl, depth, color, mark) => {
  const array = gl.createVertexArray();
  gl.bindVertexArray(array);
  [depth, color, mark].forEach((data, location) => {
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(location);
    if (location === 0) gl.vertexAttribIPointer(0, 1, gl.UNSIGNED_SHORT, 0, 0);
    else gl.vertexAttribPointer(location, location + 2, gl.UNSIGNED_BYTE, true, 0, 0);
  });
  return { array, count: depth.length };
};

const VERTEX = 10; // numbers: place, normal, colour

// A mesh with vertices that are written anew whenever the shown shapes change.
const makeMesh = (gl) => {
  const array = gl.createVertexArray(), buffer = gl.createBuffer();
  gl.bindVertexArray(array);
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  [[3, 0], [3, 3], [4, 6]].forEach(([size, offset], location) => {
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, size, gl.FLOAT, false, 4 * VERTEX, 4 * offset);
  });
  return {
    array,
    count: 0,
    fill(numbers) {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(numbers), gl.DYNAMIC_DRAW);
      this.count = numbers.length / VERTEX;
    },
  };
};

// Returns the drawing: callers fill `meshes`, `draw` takes the camera's matrices.
const makeDrawing = (gl, cloud, camera, depthStep) => {
  const points = compiled(gl, POINTS_VERTEX, POINTS_FRAGMENT);
  const mesh = compiled(gl, MESH_VERTEX, MESH_FRAGMENT);
  const loaded = loadCloud(gl, cloud.depth, cloud.color, cloud.mark);
  const meshes = { solid: makeMesh(gl), lines: makeMesh(gl), sheets: makeMesh(gl) };
  const drawMesh = (each, kind) => {
    gl.bindVertexArray(each.array);
    if (each.count) gl.drawArrays(kind, 0, each.count);
  };
  const draw = (view, shown) => {
    gl.viewport(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight);
    gl.clearColor(0.09, 0.1, 0.12, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    gl.depthMask(true);
    if (shown.points) {
      gl.useProgram(points.program);
      gl.uniformMatrix4fv(points.clip, false, view.clip);
      gl.uniform4f(points.camera, camera.fx, camera.fy, camera.cx, camera.cy);
      gl.uniform1f(points.depthStep, depthStep);
      // Neighbours are depth / fx apart; points are a little larger, so that surfaces close.
      gl.uniform1f(points.size, (1.9 * view.pixelsAtOneMetre) / Math.min(camera.fx, camera.fy));
      gl.uniform1f(points.tint, shown.tint);
      gl.uniform1i(points.columns, camera.columns);
      gl.bindVertexArray(loaded.array);
      gl.drawArrays(gl.POINTS, 0, loaded.count);
    }
    gl.useProgram(mesh.program);
    gl.uniformMatrix4fv(mesh.clip, false, view.clip);
    gl.uniform3fv(mesh.eye, view.eye);
    drawMesh(meshes.solid, gl.TRIANGLES);
    drawMesh(meshes.lines, gl.LINES);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    drawMesh(meshes.sheets, gl.TRIANGLES);
    gl.depthMask(true);
  };
  return { meshes, draw };
};
