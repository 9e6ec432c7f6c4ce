// The source of a page that runs its scene by itself: a worker ticks, and a slider writes numbers of its arena.
function openSource() {
  const worker = new Worker(URL.createObjectURL(new Blob([find("worker").textContent], { type: "text/javascript" })));
  let first = 0;
  for (const grasp of run.grasps) { grasp.first = first; first += grasp.fingers.length; }
  worker.onmessage = ({ data }) => ({ ready: onReady, frames: onFrames, reset() { forget(); }, recording: save })[data.kind](data);
  worker.onerror = (event) => { find("told").textContent = `This browser cannot run the scene: ${event.message}`; };
  const tell = (act, data = {}) => worker.postMessage({ act, ...data });
  tell("begin", { run, told: { n, d: story.dimensions, apart: story.apart, limit: story.contacts_states.findIndex(([name]) => name === "limit"), frameWidth } });
  find("download").hidden = false;
  find("download").addEventListener("click", () => tell("download"));
  find("record").addEventListener("click", () => (state.recording ? tell("unrecord") : restart(true)));
  find("judged").textContent = `Certificate when this page was made: ${run.judged}. Marks on a slider: its limit with the other values as they were then.`;
  return {
    tell, restart,
    set(i, value) {
      const each = run.sliders[i];
      run.values[i] = each.stops ? each.stops[nearestStop(each, value)] : value;
      tell("write", written(i));
    },
    lead(hand) { tell("write", writtenGoal(hand)); },
    squeeze(hand) { tell("write", writtenGoal(hand)); },
    mark: (each, value) => (!each.margin ? ["not judged", false] : isUnstable(each, value) ? ["NOT STABLE", true] : [each.margin.length ? "stable" : "stable in its range", false]),
  };
}
function onReady() {
  const asked = /^#pause$/.test(location.hash);
  tell("step", { count: run.frames }); // a picture at once
  if (!asked && !reduced.matches) tell("run");
}
function restart(record) {
  const writes = run.sliders.map((_, i) => i).filter((i) => run.values[i] !== run.sliders[i].value).map(written);
  resetGoals();
  follow = true;
  if (record && state.recorded && !state.saved) tell("download"); // what was recorded before is not lost
  tell("reset", { record, writes });
  tell("run");
}
function onFrames({ frames, tick, going, ended, recorded, recording, slow }) {
  if (recording) state.saved = false;
  Object.assign(state, { tick, going, ended, recorded, recording, slow });
  for (let from = 0; from < frames.length; from += frameWidth) append(frames.subarray(from, from + frameWidth));
  sayRun(); shown();
}
function sayRun() {
  const seconds = state.tick * run.period, parts = [`${seconds.toFixed(2)} s`, `${state.tick} ticks of ${plain(1000 * run.period)} ms`];
  if (state.slow) parts.push(`${(state.slow * run.period).toFixed(1)} s behind the clock`);
  if (state.recording || state.recorded) parts.push(`${state.recorded} rows recorded`);
  const growth = growing();
  if (growth) parts.push(growth);
  find("told").textContent = parts.join(", ");
  find("download").disabled = !state.recorded;
}

// A value is an entry of the arena itself, or picks a row of a table; two stiffnesses write a fade together.
function written(i) {
  const each = run.sliders[i], value = run.values[i], entries = [...each.itself.map((place) => [place, value]), ...each.always];
  if (each.stops) {
    const stop = nearestStop(each, value);
    each.entries.forEach((place, j) => entries.push([place, each.table[stop][j]]));
  }
  const values = [[each.key, value]];
  for (const { sliders, entries: made } of run.together) if (sliders.includes(i)) {
    const c = Math.abs(1 / run.values[sliders[0]] - 1 / run.values[sliders[1]]);
    for (const [place, floor, p, q] of made) entries.push([place, Math.max(floor, p + q * c)]);
    const split = JSON.parse(run.recording.head.split), now = new Map(entries);
    run.grasps.forEach(({ fade }, g) => {
      const rule = Object.values(split)[g];
      if (rule?.fade && now.has(fade[0])) rule.fade = fade.map((place) => now.get(place));
    });
    values.push(["split", split]);
  }
  return { entries, values };
}
const nearestStop = ({ stops }, value) => stops.reduce((best, stop, j) => (Math.abs(stop - value) < Math.abs(stops[best] - value) ? j : best), 0);
const isUnstable = ({ margin }, value) => margin?.some(([low, high]) => value >= low && value <= high);


function writtenGoal(hand) {
  const { goals, squeeze, table } = run.handles[hand], goal = run.goals[hand], flat = goal.offsets.flat();
  return {
    entries: [...goals.map((place, i) => [place, flat[i]]), [squeeze, goal.squeeze]],
    values: [[`${table}.guide.offset`, goal.offsets.map((each) => [...each])], [`${table}.guide.squeeze`, goal.squeeze]],
  };
}

// A recording as the project writes one while a run goes on: blocks with a digest each.
function save({ rows, changes, complete, fault }) {
  state.saved = true;
  const head = { ...run.recording.head, created: new Date().toISOString().slice(0, 19) + "+00:00" };
  const numbers = new Float64Array(rows.length * run.width);
  rows.forEach((row, i) => numbers.set(row, i * run.width));
  const encoder = new TextEncoder(), blocks = [["GFXJ", encoder.encode(JSON.stringify(head))], ["rows", new Uint8Array(numbers.buffer)]];
  if (fault) blocks.push(["flts", encoder.encode(JSON.stringify([fault]))]);
  if (changes.length) blocks.push(["chgs", encoder.encode(JSON.stringify(changes))]);
  const outcome = JSON.stringify({ ...run.recording.outcome, complete: complete ? 1 : 0 }).replace('"wall_time":null', '"wall_time":NaN');
  blocks.push(["done", encoder.encode(outcome)]);
  const parts = [];
  let digest = new Uint8Array(0);
  for (const [kind, content] of blocks) {
    digest = blake2b([digest, encoder.encode(kind), content], 16);
    const top = new Uint8Array(32), view = new DataView(top.buffer);
    top.set(encoder.encode(kind)); view.setUint32(4, content.length, true); top.set(digest, 12);
    view.setUint32(28, crc32(top.subarray(0, 28)), true);
    parts.push(top, content);
  }
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob(parts, { type: "application/octet-stream" }));
  link.download = "recording.h5.part";
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60000);
}
function crc32(content) {
  let crc = -1;
  for (const byte of content) { crc ^= byte; for (let i = 0; i < 8; i++) crc = crc & 1 ? (crc >>> 1) ^ 0xedb88320 : crc >>> 1; }
  return ~crc >>> 0;
}
// BLAKE2b (RFC 7693) without a key; words of 64 bits are pairs of 32, the low one first.
const SIGMA = ["0123456789abcdef", "ea489fd61c02b753", "b8c052fdae367194", "7931dcbe265a40f8", "905724afe1bc683d", "2c6a0b834d75fe19", "c51fed4a0763928b", "db7ec13950f4862a", "6fe9b308c2d714a5", "a2847615fb9e3cd0", "0123456789abcdef", "ea489fd61c02b753"]
  .map((row) => [...row].map((letter) => 2 * parseInt(letter, 16)));
const IV = Uint32Array.of(0xf3bcc908, 0x6a09e667, 0x84caa73b, 0xbb67ae85, 0xfe94f82b, 0x3c6ef372, 0x5f1d36f1, 0xa54ff53a, 0xade682d1, 0x510e527f, 0x2b3e6c1f, 0x9b05688c, 0xfb41bd6b, 0x1f83d9ab, 0x137e2179, 0x5be0cd19);
function blake2b(parts, size) {
  const h = IV.slice(), v = new Uint32Array(32), block = new Uint8Array(128), view = new DataView(block.buffer), m = new Uint32Array(32);
  h[0] ^= 0x01010000 ^ size;
  let filled = 0, count = 0;
  const sum = (a, b, x) => { // v[a] += v[b] + m[x], or without m
    let low = v[a] + v[b], high = v[a + 1] + v[b + 1];
    if (x >= 0) { low += m[x]; high += m[x + 1]; }
    v[a] = low; v[a + 1] = high + Math.floor(low / 4294967296);
  };
  const spin = (a, b, bits) => { // v[a] = (v[a] ^ v[b]) turned right
    const low = v[a] ^ v[b], high = v[a + 1] ^ v[b + 1];
    if (bits === 32) { v[a] = high; v[a + 1] = low; }
    else if (bits === 63) { v[a] = (low << 1) | (high >>> 31); v[a + 1] = (high << 1) | (low >>> 31); }
    else { v[a] = (low >>> bits) | (high << (32 - bits)); v[a + 1] = (high >>> bits) | (low << (32 - bits)); }
  };
  const mix = (a, b, c, d, x, y) => {
    sum(a, b, x); spin(d, a, 32); sum(c, d, -1); spin(b, c, 24);
    sum(a, b, y); spin(d, a, 16); sum(c, d, -1); spin(b, c, 63);
  };
  const squeeze = (last) => {
    for (let i = 0; i < 32; i++) m[i] = view.getUint32(4 * i, true);
    v.set(h); v.set(IV, 16);
    v[24] ^= count >>> 0; v[25] ^= Math.floor(count / 4294967296);
    if (last) { v[28] = ~v[28]; v[29] = ~v[29]; }
    for (const s of SIGMA) {
      mix(0, 8, 16, 24, s[0], s[1]); mix(2, 10, 18, 26, s[2], s[3]); mix(4, 12, 20, 28, s[4], s[5]); mix(6, 14, 22, 30, s[6], s[7]);
      mix(0, 10, 20, 30, s[8], s[9]); mix(2, 12, 22, 24, s[10], s[11]); mix(4, 14, 16, 26, s[12], s[13]); mix(6, 8, 18, 28, s[14], s[15]);
    }
    for (let i = 0; i < 16; i++) h[i] ^= v[i] ^ v[i + 16];
  };
  for (const part of parts) for (let from = 0; from < part.length;) {
    if (filled === 128) { count += 128; squeeze(false); filled = 0; }
    const some = Math.min(128 - filled, part.length - from);
    block.set(part.subarray(from, from + some), filled); filled += some; from += some;
  }
  block.fill(0, filled); count += filled; squeeze(true);
  return new Uint8Array(h.buffer).slice(0, size);
}
