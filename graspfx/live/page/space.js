// The scene in space: triangles with light on them, arrows, fingertips, a grid; WebGL 1 and nothing else.
const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const times = (s, a) => [s * a[0], s * a[1], s * a[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const size = (a) => Math.hypot(a[0], a[1], a[2]);
const unit = (a) => { const s = size(a); return s > 0 ? times(1 / s, a) : [1, 0, 0]; };
const finite = (a) => a.every(Number.isFinite);
const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255);

// Matrices are 4 x 4, by columns, as WebGL has them.
function product(a, b) {
  const out = new Float32Array(16);
  for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++) for (let k = 0; k < 4; k++) out[4 * c + r] += a[4 * k + r] * b[4 * c + k];
  return out;
}
const fromAxes = (x, y, z, p) => new Float32Array([...x, 0, ...y, 0, ...z, 0, ...p, 1]);
function rotated([w, x, y, z]) {
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
    [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
    [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)],
  ];
}

// The camera turns about a target; up stays up.
const UP = story.up, EAST = [1, 0, 0], NORTH = cross(UP, EAST);
const camera = {};
function resetCamera() {
  const { towards, field } = story.camera, [low, high] = story.bounds;
  Object.assign(camera, {
    target: times(0.5, add(low, high)), zoom: 1, field, follows: true,
    azimuth: Math.atan2(dot(towards, NORTH), dot(towards, EAST)), elevation: Math.asin(clamp(dot(towards, UP), -1, 1)),
  });
  camera.home = { azimuth: camera.azimuth, elevation: camera.elevation };
  const places = run && F ? frame(F - 1).fingertips.filter(finite) : []; // hands that have moved away are seen again
  if (places.length) camera.target = times(1 / places.length, places.reduce(add));
}
// A live scene may go anywhere: its hands stay in the middle of the picture, unless somebody has shifted it.
function keepInView(now, width, height) {
  const tips = now.fingertips.filter(finite);
  if (!tips.length) return;
  const [x, y] = project(times(1 / tips.length, tips.reduce(add)), seen, width, height), { right, up } = cameraAxes();
  const away = (value, all) => value - clamp(value, 0.35 * all, 0.65 * all);
  camera.target = add(camera.target, add(times(away(x, width) / seen.pixels, right), times(-away(y, height) / seen.pixels, up)));
}
function cameraAxes() {
  const { azimuth: a, elevation: e } = camera;
  const flat = add(times(Math.cos(a), EAST), times(Math.sin(a), NORTH));
  const back = add(times(Math.cos(e), flat), times(Math.sin(e), UP)); // towards the viewer
  const right = unit(cross(UP, flat)), up = cross(back, right);
  return { right, up, back };
}
// The distance from which all of the motion is seen in a window, as it is first looked at.
function distanceFor(aspect) {
  const now = { azimuth: camera.azimuth, elevation: camera.elevation };
  Object.assign(camera, camera.home);
  const { right, up, back } = cameraAxes(), [low, high] = story.bounds, middle = times(0.5, add(low, high));
  Object.assign(camera, now);
  const t = Math.tan((0.5 * camera.field * Math.PI) / 180) * 0.86; // with room at the rim
  let most = 0.1 * story.extent;
  for (let k = 0; k < 8; k++) {
    const corner = sub([0, 1, 2].map((i) => (k & (1 << i) ? high : low)[i]), middle);
    most = Math.max(most, dot(corner, back) + Math.max(Math.abs(dot(corner, up)) / t, Math.abs(dot(corner, right)) / (t * aspect)));
  }
  return most * camera.zoom;
}
function viewing(width, height) {
  const { right, up, back } = cameraAxes(), d = distanceFor(width / height);
  const eye = add(camera.target, times(d, back));
  const f = 1 / Math.tan((0.5 * camera.field * Math.PI) / 180), near = 0.02 * d, far = 40 * d;
  const view = new Float32Array([
    right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
    -dot(right, eye), -dot(up, eye), -dot(back, eye), 1,
  ]);
  const lens = new Float32Array(16);
  lens[0] = (f * height) / width; lens[5] = f; lens[10] = (far + near) / (near - far); lens[11] = -1;
  lens[14] = (2 * far * near) / (near - far);
  return { right, up, back, eye, view, matrix: product(lens, view), pixels: (0.5 * f * height) / d };
}
// Where a point of the scene is seen, in CSS pixels of the picture.
function project(point, { matrix: m }, width, height) {
  const row = (r) => m[r] * point[0] + m[4 + r] * point[1] + m[8 + r] * point[2] + m[12 + r];
  const w = row(3);
  return [0.5 * width * (1 + row(0) / w), 0.5 * height * (1 - row(1) / w), w];
}

// Shapes that are drawn many times: unit ones, each with its normals.
function ballShape(turn = 32, rings = 16) {
  const points = [], faces = [];
  for (let j = 0; j <= rings; j++) for (let i = 0; i <= turn; i++) {
    const t = (Math.PI * j) / rings, p = (2 * Math.PI * i) / turn;
    points.push(Math.sin(t) * Math.cos(p), Math.sin(t) * Math.sin(p), Math.cos(t));
  }
  for (let j = 0; j < rings; j++) for (let i = 0; i < turn; i++) {
    const a = j * (turn + 1) + i, b = a + turn + 1;
    faces.push(a, b, a + 1, a + 1, b, b + 1);
  }
  return { vertices: new Float32Array(points), normals: new Float32Array(points), faces: new Uint16Array(faces) };
}
function turnedShape(profile, turn = 28) { // of [radius, height along z, normal's radius, normal's height]
  const points = [], normals = [], faces = [];
  profile.forEach(([r, z, nr, nz]) => {
    for (let i = 0; i <= turn; i++) {
      const c = Math.cos((2 * Math.PI * i) / turn), s = Math.sin((2 * Math.PI * i) / turn);
      points.push(r * c, r * s, z); normals.push(nr * c, nr * s, nz);
    }
  });
  for (let j = 0; j + 1 < profile.length; j += 2) for (let i = 0; i < turn; i++) {
    const a = j * (turn + 1) + i, b = a + turn + 1;
    faces.push(a, a + 1, b, a + 1, b + 1, b);
  }
  return { vertices: new Float32Array(points), normals: new Float32Array(normals), faces: new Uint16Array(faces) };
}

const VERTEX = `attribute vec3 vertex, normal; uniform mat4 place, seen; uniform vec3 grow; varying vec3 direction;
void main() { vec4 world = place * vec4(vertex * grow, 1.0); direction = mat3(place) * (normal / grow);
  gl_Position = seen * world; }`;
const FRAGMENT = `precision mediump float; varying vec3 direction; uniform vec4 colour; uniform vec3 light, half_way, towards;
uniform vec4 shade; uniform float flat_, both;
void main() { vec3 d = normalize(direction); if (both > 0.5 && dot(d, towards) < 0.0) d = -d;
  float matt = mix(shade.x + shade.y * max(dot(d, light), 0.0), 1.0, flat_);
  float gloss = (1.0 - flat_) * shade.z * pow(max(dot(d, half_way), 0.0), shade.w);
  gl_FragColor = vec4(min(colour.rgb * matt + gloss, 1.0), colour.a); }`;

class Space {
  constructor(canvas) {
    this.canvas = canvas;
    const gl = this.gl = canvas.getContext("webgl", { antialias: true, alpha: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("no WebGL");
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text); gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program); gl.useProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    this.where = (name) => gl.getUniformLocation(program, name);
    this.places = Object.fromEntries(["place", "seen", "grow", "colour", "light", "half_way", "towards", "shade", "flat_", "both"].map((name) => [name, this.where(name)]));
    this.attributes = { vertex: gl.getAttribLocation(program, "vertex"), normal: gl.getAttribLocation(program, "normal") };
    gl.getExtension("OES_element_index_uint");
    gl.enable(gl.DEPTH_TEST); gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    this.ball = this.buffered(ballShape());
    this.shaft = this.buffered(turnedShape([[1, 0, 1, 0], [1, 1, 1, 0], [0, 0, 0, -1], [1, 0, 0, -1]]));
    this.head = this.buffered(turnedShape([[1, 0, 0.9, 0.44], [0, 1, 0.9, 0.44], [0, 0, 0, -1], [1, 0, 0, -1]]));
    this.solids = story.solids.map((each) => ({ ...each, shape: this.buffered({
      vertices: unpack(each.vertices), normals: Float32Array.from(unpack(each.normals), (x) => x / 127), faces: unpack(each.faces),
    }) }));
    this.grid = this.buffered(gridLines());
  }
  buffered({ vertices, normals, faces }) {
    const gl = this.gl, put = (kind, values) => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(kind, buffer); gl.bufferData(kind, values, gl.STATIC_DRAW);
      return buffer;
    };
    return {
      vertices: put(gl.ARRAY_BUFFER, vertices), normals: put(gl.ARRAY_BUFFER, normals),
      faces: put(gl.ELEMENT_ARRAY_BUFFER, faces), count: faces.length,
      kind: faces instanceof Uint32Array ? gl.UNSIGNED_INT : gl.UNSIGNED_SHORT,
    };
  }
  draw(shape, place, colour, { grow = [1, 1, 1], flat = 0, both = 0, alpha = 1, lines = false } = {}) {
    const gl = this.gl, at = this.places;
    for (const name of ["vertex", "normal"]) {
      gl.bindBuffer(gl.ARRAY_BUFFER, name === "vertex" ? shape.vertices : shape.normals);
      gl.enableVertexAttribArray(this.attributes[name]);
      gl.vertexAttribPointer(this.attributes[name], 3, gl.FLOAT, false, 0, 0);
    }
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, shape.faces);
    gl.uniformMatrix4fv(at.place, false, place);
    gl.uniform3fv(at.grow, grow); gl.uniform4f(at.colour, ...colour, alpha);
    gl.uniform1f(at.flat_, flat); gl.uniform1f(at.both, both);
    gl.drawElements(lines ? gl.LINES : gl.TRIANGLES, shape.count, shape.kind, 0);
  }
  // Draws a frame; `width` and `height` in CSS pixels, `paper` and `line` colours.
  show(now, width, height, paper, line) {
    const gl = this.gl, seen = viewing(width, height), { lighting } = story;
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(...paper, 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const inWorld = (v) => add(add(times(v[0], seen.right), times(v[1], seen.up)), times(v[2], seen.back));
    const light = unit(inWorld(lighting.light));
    gl.uniformMatrix4fv(this.places.seen, false, seen.matrix);
    gl.uniform3fv(this.places.light, light); gl.uniform3fv(this.places.half_way, unit(add(light, seen.back)));
    gl.uniform3fv(this.places.towards, seen.back);
    gl.uniform4f(this.places.shade, lighting.ambient, lighting.diffuse, lighting.gloss, lighting.sharpness);
    const still = fromAxes([1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]);
    gl.disable(gl.BLEND); gl.depthMask(true); gl.depthFunc(gl.LESS);
    gl.enable(gl.POLYGON_OFFSET_FILL); gl.polygonOffset(1, 1);
    for (const each of this.solids) {
      let place = still;
      if (each.object >= 0) {
        const pose = now.objects[each.object];
        if (!finite(pose.position) || !finite(pose.wxyz)) continue;
        place = fromAxes(...rotated(pose.wxyz), pose.position);
      }
      this.draw(each.shape, place, rgb(each.colour), { both: each.endless ? 1 : 0 });
    }
    gl.disable(gl.POLYGON_OFFSET_FILL);
    gl.enable(gl.BLEND); gl.depthMask(false);
    this.draw(this.grid, still, line, { flat: 1, alpha: 0.5, lines: true });
    const marks = this.marks(now, seen);
    gl.depthFunc(gl.GREATER); // what solids hide shows through them, pale
    for (const mark of marks) this.draw(mark.shape, mark.place, mark.colour, { grow: mark.grow, flat: 1, alpha: 0.3 });
    gl.disable(gl.BLEND); gl.depthMask(true); gl.depthFunc(gl.LESS);
    for (const mark of marks) this.draw(mark.shape, mark.place, mark.colour, { grow: mark.grow });
    return seen;
  }
  // Fingertips in the colour of their state, and arrows.
  marks(now, seen) {
    const list = [], colours = Object.fromEntries(story.contacts_states);
    story.fingers.forEach((finger, i) => {
      const tip = now.fingertips[i];
      if (!finite(tip)) return;
      const r = finger.radius;
      list.push({ shape: this.ball, place: fromAxes([1, 0, 0], [0, 1, 0], [0, 0, 1], tip), grow: [r, r, r], colour: rgb(colours[now.states[i]]) });
    });
    for (const arrow of arrows(now, seen)) {
      const along = sub(arrow.tip, arrow.tail), length = size(along), z = unit(along);
      const x = unit(cross(Math.abs(z[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0], z)), y = cross(z, x);
      const half = story.arrow.shaft * story.arrow.thick, point = Math.min(story.arrow.head * half, story.arrow.most * length);
      const wide = story.arrow.wide * half * Math.min(1, (1.5 * point) / (story.arrow.head * half));
      list.push({ shape: this.shaft, place: fromAxes(x, y, z, arrow.tail), grow: [half, half, length - point], colour: rgb(arrow.colour) });
      list.push({ shape: this.head, place: fromAxes(x, y, z, sub(arrow.tip, times(point, z))), grow: [wide, wide, point], colour: rgb(arrow.colour) });
    }
    return list;
  }
}

// Arrows of forces: outside of the object, ending where a force pushes in, beginning where it pulls out; two that would
// lie on one another as seen stand side by side.
function arrows(now, seen) {
  const list = [], { arrow, extent } = story, scale = arrow.scale;
  const parts = now.internal ? [[now.internal, story.colours.internal], [now.external, story.colours.external]]
    : now.force ? [[now.force, ""]] : [];
  story.fingers.forEach((finger, i) => {
    const tip = now.fingertips[i], contact = !story.attached && finite(now.contacts[i]) ? now.contacts[i] : tip;
    if (!finite(tip)) return;
    const whole = now.force ? now.force[i] : [0, 0, 0], own = [];
    for (const [values, colour] of parts) {
      const f = values[i], strength = size(f);
      if (!finite(f) || strength * scale < arrow.shortest * arrow.longest * extent) continue;
      const pulls = dot(f, whole) < -1e-9 * strength * size(whole);
      const at = finger.ball ? add(tip, times(((pulls ? 1 : -1) * finger.radius) / strength, f)) : contact;
      own.push({ finger: i, colour: colour || finger.colour, tail: pulls ? at : sub(at, times(scale, f)), tip: pulls ? add(at, times(scale, f)) : at });
    }
    if (own.length === 2) {
      const flat = own.map((each) => { const v = sub(each.tip, each.tail); return [dot(v, seen.right), dot(v, seen.up)]; });
      const area = Math.hypot(...flat[0]) * Math.hypot(...flat[1]);
      if (area > 0 && Math.abs(flat[0][0] * flat[1][1] - flat[0][1] * flat[1][0]) <= arrow.along * area) {
        const s = Math.hypot(...flat[0]), shift = (arrow.apart * arrow.shaft * arrow.thick) / s;
        const aside = add(times(-flat[0][1] * shift, seen.right), times(flat[0][0] * shift, seen.up));
        own.forEach((each, k) => { const by = times(k ? -1 : 1, aside); each.tail = add(each.tail, by); each.tip = add(each.tip, by); });
      }
    }
    list.push(...own);
  });
  return list;
}

// A grid on the ground, or behind what happens in the plane.
function gridLines() {
  const { cell, count, origin, u, v } = story.grid, points = [], faces = [];
  for (const [a, b] of [[u, v], [v, u]]) for (let i = -count; i <= count; i++) {
    const middle = add(origin, times(i * cell, a)), half = times(count * cell, b);
    faces.push(points.length / 3, points.length / 3 + 1);
    points.push(...sub(middle, half), ...add(middle, half));
  }
  return { vertices: new Float32Array(points), normals: new Float32Array(points.length).fill(0.577), faces: new Uint16Array(faces) };
}
