// The worker of a page that runs a scene: ticks by the clock, frames and charts of them, and rows for a recording.
const BEHIND = 0.1; // [s] by which ticks may be late before the clock waits for them
const MOST_ROWS = 256e6; // bytes of a recording
let run, told, memory, entry, at, arena, rows, first, k, going = false, speed = 1, anchor, timer = 0, ended = "";
let frame, lines, ready = [], slow = 0;
let kept = [], keptBytes = 0, changes = [], fault = "", recording = false; // of the last recording, which a restart leaves alone

// Base 85 of bytes, five letters for four of them, in the order of RFC 1924 but for letters that HTML would escape.
const LETTERS = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%,()*+-;.=:?@^_`{|}~";
function bytesOf(text) {
  const values = new Uint8Array(128), count = text.length, out = new DataView(new ArrayBuffer(4 * Math.ceil(count / 5)));
  for (let i = 0; i < 85; i++) values[LETTERS.charCodeAt(i)] = i;
  for (let i = 0; i < count; i += 5) {
    let word = 0;
    for (let j = i; j < i + 5; j++) word = 85 * word + (j < count ? values[text.charCodeAt(j)] : 84);
    out.setUint32((4 * i) / 5, word);
  }
  return new Uint8Array(out.buffer, 0, Math.floor((4 * count) / 5));
}
const unzip = async (text) => {
  const raw = bytesOf(text);
  return new Uint8Array(await new Response(new Blob([raw]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer());
};
const spread = (found, places) => new Uint8Array(BigUint64Array.from(places, (place) => found[place]).buffer);

async function begin(data) {
  ({ run, told } = data);
  const [code, found, places] = await Promise.all([run.module, run.arena.numbers, run.arena.places].map(unzip));
  const numbers = spread(new BigUint64Array(found.buffer), new (run.arena.kind === "u2" ? Uint16Array : Uint32Array)(places.buffer));
  const { exports } = (await WebAssembly.instantiate(code)).instance;
  ({ memory, graspfx_entry: entry } = exports);
  at = (exports.__heap_base.value + 15) & ~15;
  const outside = 8 * (run.width + 3 * told.n); // behind the arena: a row, and the external forces
  const missing = at + numbers.byteLength + outside - memory.buffer.byteLength;
  if (missing > 0) memory.grow(Math.ceil(missing / 65536));
  first = numbers;
  arena = new Float64Array(memory.buffer, at, numbers.byteLength / 8);
  rows = new Float64Array(memory.buffer, at + numbers.byteLength, outside / 8);
  reset();
  postMessage({ kind: "ready" });
}

function reset() {
  new Uint8Array(memory.buffer).set(first, at);
  k = 0; ended = ""; frame = null; lines = null; ready = []; slow = 0;
  anchor = [performance.now(), 0];
}

const call = (place, count, r) => Number(entry(at, at + first.byteLength, BigInt(place), BigInt(k), BigInt(count), BigInt(r)));

function tick() {
  call(run.world, 1, 0);
  for (const grasp of run.grasps) call(grasp.state, -2, run.width + 3 * grasp.first);
  if (recording) keep();
  look();
  k += 1;
  const [faulted, when, kind, index, code] = run.faults.places.map((place) => arena[place]);
  if (faulted && when < k) {
    ended = (run.faults.texts[`${kind} ${index} ${code}`] ?? `fault ${code} of part ${kind}, ${index}; all forces are zero`)
      .replace("(force)", () => String(Number(arena[run.faults.forces[index]].toPrecision(3))));
    if (frame) ready.push(frame); // its group is cut short
    frame = null;
    if (recording) fault = [k - 1, ended];
    stop();
  }
}

function keep() {
  if (keptBytes + 8 * run.width > MOST_ROWS) { recording = false; return; }
  kept.push(rows.slice(0, run.width)); keptBytes += 8 * run.width;
}

// A frame has the first tick of its group; charts have the least and the greatest of all of them.
function look() {
  const { n, d } = told, row = run.row, begins = k % run.frames === 0;
  if (begins) frame = new Float64Array(told.frameWidth);
  if (!frame) return;
  const lift = (place, i) => [0, 1, 2].map((a) => (a < d && place >= 0 ? rows[place + d * i + a] : 0));
  const internal = [], external = [], contact = [], touches = [];
  run.grasps.forEach((grasp) => {
    const R = turn(row.objects[grasp.object]);
    grasp.fingers.forEach((i, own) => {
      const from = run.width + 3 * (grasp.first + own), f = [rows[from], rows[from + 1], rows[from + 2]];
      const touching = row.touching < 0 || rows[row.touching + i] > 0;
      touches[i] = touching; contact[i] = lift(row.contact, i);
      external[i] = touching ? [0, 1, 2].map((a) => R[a][0] * f[0] + R[a][1] * f[1] + R[a][2] * f[2]) : [0, 0, 0];
      internal[i] = touching ? lift(row.force, i).map((x, a) => x - external[i][a]) : [0, 0, 0];
    });
  });
  if (begins) {
    let to = 0;
    const put = (values) => { for (const x of values) frame[to++] = x; };
    for (const [place, tips] of [[row.tip, true], [row.contact, false]]) for (let i = 0; i < n; i++) {
      const p = lift(place, i);
      p[1] += told.apart[i];
      put(tips || touches[i] ? p : [NaN, NaN, NaN]);
    }
    for (let i = 0; i < n; i++) {
      let state = touches[i] ? 1 : 0;
      if (state && row.status >= 0 && rows[row.status + i] > 0) state = 1 + rows[row.status + i];
      if (touches[i] && row.saturated >= 0 && rows[row.saturated + i] > 0) state = told.limit;
      put([state]);
    }
    for (let i = 0; i < n; i++) put(internal[i] ?? [0, 0, 0]);
    for (let i = 0; i < n; i++) put(external[i] ?? [0, 0, 0]);
    for (const thing of row.objects) put(pose(thing));
    lines = to;
  }
  let to = lines;
  const add = (value) => {
    if (begins) frame[to] = frame[to + 1] = frame[to + 2] = value;
    else { frame[to + 1] = least(frame[to + 1], value); frame[to + 2] = -least(-frame[to + 2], -value); }
    to += 3;
  };
  run.grasps.forEach((grasp) => [squeeze(grasp, internal, contact, touches), ...push(grasp, external, touches)].slice(0, 1 + d).forEach(add));
  if (row.gap >= 0) for (let i = 0; i < n; i++) add(1000 * Math.max(0, -rows[row.gap + i]));
  if ((k + 1) % run.frames === 0) { ready.push(frame); frame = null; }
}
const least = (a, b) => (Number.isNaN(a) ? b : Number.isNaN(b) ? a : Math.min(a, b));

// Mean of the touching fingers' internal forces towards the middle of the contacts; of their external forces.
function squeeze(grasp, internal, contact, touches) {
  const all = grasp.fingers, held = all.filter((i) => touches[i]);
  if (held.length < 2) return NaN;
  const middle = [0, 1, 2].map((a) => all.reduce((sum, i) => sum + contact[i][a], 0) / all.length);
  let sum = 0;
  held.forEach((i) => {
    const away = middle.map((x, a) => x - contact[i][a]), length = Math.hypot(...away);
    let inward = length > 1e-9 ? away.map((x) => x / length) : [0, 0, 0];
    if (length <= 1e-9 && all.length === 2) {
      const apart = [0, 1, 2].map((a) => tipOf(all[0], a) - tipOf(all[1], a)), size = apart.map(Math.abs);
      inward = [0, 0, 0]; inward[size.indexOf(Math.max(...size))] = i === all[0] ? 1 : -1;
    }
    sum += inward.reduce((s, x, a) => s + x * internal[i][a], 0);
  });
  return sum / held.length;
}
const tipOf = (i, a) => (a < told.d ? rows[run.row.finger + told.d * i + a] : 0);
function push(grasp, external, touches) {
  const held = grasp.fingers.filter((i) => touches[i]);
  return [0, 1, 2].map((a) => (held.length ? held.reduce((sum, i) => sum + external[i][a], 0) / held.length : NaN));
}

// Rotations: of the row's orientation, an angle or a quaternion x, y, z, w.
function quaternion(thing) {
  const q = thing.orientation;
  if (q < 0 || told.d === 1) return [1, 0, 0, 0];
  if (told.d === 2) return [Math.cos(0.5 * rows[q]), 0, 0, Math.sin(0.5 * rows[q])];
  return [rows[q + 3], rows[q], rows[q + 1], rows[q + 2]];
}
const matrix = ([w, x, y, z]) => [
  [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
  [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
  [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
];
const turn = (thing) => matrix(quaternion(thing));
// Of the frame in which the shape is described: a mesh file's, or the object's own.
function pose(thing) {
  let p = [0, 1, 2].map((a) => (a < told.d && thing.position >= 0 ? rows[thing.position + a] : 0)), q = quaternion(thing);
  if (thing.frame) {
    const R = matrix(q), o = thing.frame.position, [x, y, z, w] = thing.frame.orientation, [W, X, Y, Z] = q;
    p = p.map((value, a) => value + R[a][0] * o[0] + R[a][1] * o[1] + R[a][2] * o[2]);
    q = [W * w - X * x - Y * y - Z * z, W * x + X * w + Y * z - Z * y, W * y - X * z + Y * w + Z * x, W * z + X * y - Y * x + Z * w];
  }
  return [...p, ...q];
}

// The clock -------------------------------------------------------------------------------------------------------------
function loop() {
  timer = 0;
  if (!going) return;
  const now = performance.now(), pace = speed / (1000 * run.period);
  let due = Math.floor((now - anchor[0]) * pace) - (k - anchor[1]);
  const most = Math.max(1, Math.ceil(BEHIND / run.period * speed));
  if (due > most) { slow += due - most; due = most; anchor = [now, k + due]; }
  for (; due > 0 && going; due--) tick();
  report();
  if (going) timer = setTimeout(loop, 4);
}
function start() { if (ended || going) return; going = true; anchor = [performance.now(), k]; loop(); }
function stop() { going = false; if (timer) clearTimeout(timer); timer = 0; }
function report() {
  const frames = new Float64Array(ready.length * told.frameWidth);
  ready.forEach((each, i) => frames.set(each, i * told.frameWidth));
  ready = [];
  postMessage({ kind: "frames", frames, tick: k, going, ended, slow, recorded: kept.length, recording }, [frames.buffer]);
}

const acts = {
  begin, run: start, pause() { stop(); report(); },
  step({ count }) { stop(); for (let i = 0; i < count && !ended; i++) tick(); report(); },
  speed(data) { speed = data.speed; anchor = [performance.now(), k]; },
  reset({ record, writes }) {
    stop(); reset(); recording = record;
    if (record) { kept = []; keptBytes = 0; changes = []; fault = ""; }
    writes.forEach((each) => write(each)); postMessage({ kind: "reset" }); report();
  },
  unrecord() { recording = false; report(); },
  write(data) { write(data); },
  download() { postMessage({ kind: "recording", rows: kept, changes, complete: !going || !recording, fault }); },
};
// Numbers of the arena between two ticks, as a live change of the project's, and what a recording says of it.
function write({ entries, values }) {
  for (const [place, number] of entries) arena[place] = number;
  if (recording) for (const [key, value] of values) changes.push([k, key, value]);
}
onmessage = ({ data }) => acts[data.act](data);
