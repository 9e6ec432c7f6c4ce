// Numbers of the recording: arrays from their packing, and the frame of any instant between two that are there.
const story = JSON.parse(document.getElementById("story").textContent);

function bytes(text) {
  const raw = atob(text), out = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) out[i] = raw.charCodeAt(i);
  return out.buffer;
}

// An array is packed as its kind and its bytes, little-endian, which is how every machine with a browser has them.
const KINDS = { f4: Float32Array, i1: Int8Array, u1: Uint8Array, u2: Uint16Array, u4: Uint32Array };
const unpack = (packed) => new KINDS[packed.kind](bytes(packed.data));

const find = (id) => document.getElementById(id);
const n = story.fingers.length;
// Frames that are there: all of a recording; of a page that runs the last minute, from the time `origin` on.
const MINUTE = Math.ceil(60 / story.step);
let F = story.run ? 0 : story.frames, origin = story.run ? 0 : story.start;
const empty = (count, kind = Float32Array) => new kind(count * MINUTE);
const tracks = story.run ? {
  fingertips: empty(3 * n), contacts: empty(3 * n), states: empty(n, Uint8Array), internal: empty(3 * n), external: empty(3 * n), force: null,
  objects: story.objects.map(() => ({ position: empty(3), wxyz: empty(4) })),
} : {
  fingertips: unpack(story.fingertips), contacts: unpack(story.contacts), states: unpack(story.states),
  internal: story.internal && unpack(story.internal), external: story.external && unpack(story.external),
  force: story.force && unpack(story.force),
  objects: story.objects.map((each) => ({ position: unpack(each.position), wxyz: unpack(each.wxyz) })),
};
const lastTime = () => origin + Math.max(F - 1, 0) * story.step;
// Drops the oldest quarter where there is no room for another frame.
function makeRoom() {
  if (F < MINUTE) return;
  const gone = Math.ceil(MINUTE / 4), shift = (track, count) => track.copyWithin(0, gone * count, F * count);
  for (const name of ["fingertips", "contacts", "internal", "external"]) shift(tracks[name], 3 * n);
  shift(tracks.states, n); shift(strengths, 1);
  for (const each of tracks.objects) { shift(each.position, 3); shift(each.wxyz, 4); }
  for (const chart of charts) for (const line of chart.lines) for (const name of ["now", "low", "high"]) shift(line[name], 1);
  F -= gone; origin += gone * story.step;
}
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);

function triple(track, k, i) {
  const at = 3 * (n * k + i);
  return [track[at], track[at + 1], track[at + 2]];
}

// Frame k as it was recorded: the same numbers, rounded to 24 bits each.
function frame(k) {
  k = clamp(Math.round(k), 0, F - 1);
  const each = (track) => track && story.fingers.map((_, i) => triple(track, k, i));
  const internal = each(tracks.internal), external = each(tracks.external);
  return {
    time: origin + k * story.step, tick: Math.round(origin / story.step + k) * story.ticks,
    fingertips: each(tracks.fingertips), contacts: each(tracks.contacts),
    internal, external, // what squeezes and what pushes is the whole force
    force: internal ? internal.map((f, i) => f.map((x, a) => x + external[i][a])) : each(tracks.force),
    states: story.fingers.map((_, i) => story.contacts_states[tracks.states[n * k + i]][0]),
    objects: tracks.objects.map((each) => ({
      position: [...each.position.subarray(3 * k, 3 * k + 3)], wxyz: [...each.wxyz.subarray(4 * k, 4 * k + 4)],
    })),
  };
}

const between = (a, b, s) => a.map((x, i) => {
  const y = b[i];
  return Number.isNaN(x) ? (s < 0.5 ? x : y) : Number.isNaN(y) ? (s < 0.5 ? x : y) : x + s * (y - x);
});

function turned(a, b, s) {
  const sign = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] < 0 ? -1 : 1;
  const q = a.map((x, i) => x + s * (sign * b[i] - x)), size = Math.hypot(...q) || 1;
  return q.map((x) => x / size);
}

// The frame of a time: straight lines between recorded frames, states of the one before.
function frameAt(time) {
  const u = clamp((time - origin) / story.step, 0, F - 1), k = Math.min(Math.floor(u + 1e-6), F - 1), s = u - k;
  const a = frame(k);
  if (s < 1e-6 || k + 1 >= F) return a;
  const b = frame(k + 1), mix = (name) => a[name] && a[name].map((x, i) => between(x, b[name][i], s));
  return {
    ...a, time,
    fingertips: mix("fingertips"), contacts: mix("contacts"),
    internal: mix("internal"), external: mix("external"), force: mix("force"),
    objects: a.objects.map((each, i) => ({
      position: between(each.position, b.objects[i].position, s), wxyz: turned(each.wxyz, b.objects[i].wxyz, s),
    })),
  };
}
