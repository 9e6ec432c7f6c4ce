// A page that runs its scene by itself: a worker ticks, and frames come from it. Without a run this part does nothing.
const run = story.run, worker = run ? new Worker(URL.createObjectURL(new Blob([find("worker").textContent], { type: "text/javascript" }))) : null;
const state = { going: false, ended: "", tick: 0, recorded: 0, recording: false, slow: 0 };
const STEP = 0.001; // [m] of an arrow key
const frameWidth = run ? 13 * n + 7 * story.objects.length + run.grasps.length * 3 * (1 + story.dimensions) : 0;
let follow = true, drags = new Map(), begun = 0;

function tell(act, data = {}) { worker.postMessage({ act, ...data }); }

function startRun() {
  let first = 0;
  for (const grasp of run.grasps) { grasp.first = first; first += grasp.fingers.length; }
  worker.onmessage = ({ data }) => ({ ready: onReady, frames: onFrames, reset() { forget(); }, recording: save })[data.kind](data);
  worker.onerror = (event) => { find("told").textContent = `This browser cannot run the scene: ${event.message}`; };
  run.values = run.sliders.map((each) => each.value);
  run.goals = run.handles.map((each) => ({ offsets: each.fingers.map(() => Array(story.dimensions).fill(0)), squeeze: 0 }));
  begun = performance.now();
  tell("begin", { run, told: { n, d: story.dimensions, apart: story.apart, limit: story.contacts_states.findIndex(([name]) => name === "limit"), frameWidth } });
  writeSliders(); writeHandles();
  find("live").hidden = find("restart").hidden = find("record").hidden = find("download").hidden = false;
  find("restart").addEventListener("click", () => restart(false));
  find("record").addEventListener("click", () => (state.recording ? tell("unrecord") : restart(true)));
  find("download").addEventListener("click", () => tell("download"));
}
function onReady() {
  state.ready = performance.now();
  const asked = /^#pause$/.test(location.hash);
  tell("step", { count: run.frames }); // a picture at once
  if (!asked && !reduced.matches) tell("run");
}
function restart(record) {
  const writes = run.sliders.map((_, i) => i).filter((i) => run.values[i] !== run.sliders[i].value).map(written);
  run.goals = run.handles.map((each) => ({ offsets: each.fingers.map(() => Array(story.dimensions).fill(0)), squeeze: 0 }));
  for (const slider of document.querySelectorAll("#handles input")) { slider.value = 0; slider.dispatchEvent(new Event("shown")); }
  follow = true;
  if (record && state.recorded && !state.saved) tell("download"); // what was recorded before is not lost
  tell("reset", { record, writes });
  tell("run");
}

// Frames ---------------------------------------------------------------------------------------------------------------
function onFrames({ frames, tick, going, ended, recorded, recording, slow }) {
  const was = state.ended;
  state.first ??= performance.now();
  if (recording) state.saved = false;
  Object.assign(state, { tick, going, ended, recorded, recording, slow });
  for (let from = 0; from < frames.length; from += frameWidth) append(frames.subarray(from, from + frameWidth));
  if (playing !== going) { playing = going; showPlaying(); }
  if (ended && !was) { find("banner").textContent = ended; find("banner").hidden = false; }
  if (follow) time = lastTime();
  sayRun(); redraw();
}
function append(values) {
  makeRoom();
  let from = 0;
  const take = (track, count, k = F) => { track.set(values.subarray(from, from + count), count * k); from += count; };
  take(tracks.fingertips, 3 * n); take(tracks.contacts, 3 * n); take(tracks.states, n);
  take(tracks.internal, 3 * n); take(tracks.external, 3 * n);
  for (const each of tracks.objects) { take(each.position, 3); take(each.wxyz, 4); }
  for (const chart of charts) for (const line of chart.lines) {
    [line.now[F], line.low[F], line.high[F]] = values.subarray(from, from + 3);
    from += 3;
  }
  F += 1;
}
function forget() { F = 0; origin = 0; time = 0; find("banner").hidden = true; for (const chart of charts) chart.range = [0, 0.1]; }

// What stands beside it ------------------------------------------------------------------------------------------------
function sayRun() {
  const seconds = state.tick * run.period, parts = [`${seconds.toFixed(2)} s`, `${state.tick} ticks of ${plain(1000 * run.period)} ms`];
  if (state.slow) parts.push(`${(state.slow * run.period).toFixed(1)} s behind the clock`);
  if (state.recording || state.recorded) parts.push(`${state.recorded} rows recorded`);
  const growth = growing();
  if (growth) parts.push(growth);
  find("told").textContent = parts.join(", ");
  find("record").textContent = state.recording ? "■ Stop recording" : "● Record";
  find("download").disabled = !state.recorded;
}
// How far the squeeze swings in half a second, and which force has swung farther three times in a row, by a half each.
function growing() {
  const half = Math.round(0.5 / story.step);
  if (!charts.length || F < 4 * half) return "";
  const swings = ({ low, high }) => [3, 2, 1, 0].map((back) => {
    let least = Infinity, most = -Infinity;
    for (let k = F - (back + 1) * half; k < F - back * half; k++) { least = Math.min(least, low[k]); most = Math.max(most, high[k]); }
    return 0.5 * (most - least);
  });
  const grows = charts.flatMap((chart) => chart.lines).find((line) => {
    const sizes = swings(line);
    return sizes[3] > 0.01 && sizes.every((size, i) => i === 0 || size > 1.5 * sizes[i - 1]);
  }), now = swings(charts[0].lines[0])[3];
  find("told").classList.toggle("grows", Boolean(grows));
  return [Number.isFinite(now) && `squeeze swings by ${(1000 * now).toFixed(1)} mN`, grows && `${grows.name} GROWS`].filter(Boolean).join(", ");
}

// Sliders: a value is an entry of the arena itself, or picks a row of a table; two stiffnesses write a fade together.
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

function writeSliders() {
  const box = find("sliders");
  run.sliders.forEach((each, i) => {
    const label = text(box, "label", each.unit ? `${each.label} [${each.unit}]` : each.label), slider = document.createElement("input"), number = document.createElement("input"), mark = document.createElement("span"), band = document.createElement("i");
    slider.type = "range"; number.type = "number"; label.className = "number";
    for (const [name, value] of Object.entries({ min: each.least, max: each.most, step: each.stops ? each.stops[1] - each.stops[0] : each.step, value: each.value })) slider[name] = number[name] = value;
    slider.step = each.stops ? each.stops[1] - each.stops[0] : each.step; number.step = "any";
    slider.setAttribute("aria-label", each.label);
    mark.className = "mark"; band.className = "band";
    const share = (value) => `${(100 * (value - each.least)) / (each.most - each.least)}%`;
    if (each.margin?.length) band.style.backgroundImage = each.margin.map(([low, high]) => `linear-gradient(to right, transparent ${share(low)}, var(--unstable) ${share(low)}, var(--unstable) ${share(high)}, transparent ${share(high)})`).join(",");
    const show = () => {
      const value = run.values[i], bad = isUnstable(each, value);
      slider.value = value; number.value = plain(value);
      label.classList.toggle("unstable", Boolean(bad));
      mark.textContent = !each.margin ? "not judged" : bad ? "NOT STABLE" : each.margin.length ? "stable" : "stable in its range";
    };
    const set = (value) => {
      if (!Number.isFinite(value)) return show();
      const inside = clamp(value, each.least, each.most);
      run.values[i] = each.stops ? each.stops[nearestStop(each, inside)] : inside;
      tell("write", written(i)); show();
    };
    slider.addEventListener("input", () => set(Number(slider.value)));
    number.addEventListener("change", () => set(Number(number.value)));
    label.append(slider, number, mark, band); show();
    each.set = set;
  });
  for (const preset of run.presets) {
    const button = text(find("presets"), "button", preset.name);
    button.type = "button";
    button.addEventListener("click", () => {
      for (const [i, value] of preset.values) run.sliders[i].set(value);
      if (state.ended) restart(false);
    });
  }
  find("judged").textContent = `Certificate when this page was made: ${run.judged}. Marks on a slider: its limit with the other values as they were then.`;
}

// Hands: a fingertip is dragged, by mouse or by touch, or moved by keys; with shift all fingers of its hand.
function handOf(finger) {
  const hand = run.handles.findIndex((each) => each.fingers.includes(finger));
  return hand < 0 ? null : [hand, run.handles[hand].fingers.indexOf(finger)];
}
function moveTo(hand, own, offset) {
  const goal = run.goals[hand], limit = run.handles[hand].farthest;
  const inside = offset.slice(0, story.dimensions).map((x) => clamp(x, -limit, limit));
  if (own === null) goal.offsets = goal.offsets.map(() => [...inside]); else goal.offsets[own] = inside;
  tell("write", writtenGoal(hand));
}
function writtenGoal(hand) {
  const { goals, squeeze, table } = run.handles[hand], goal = run.goals[hand], flat = goal.offsets.flat();
  return {
    entries: [...goals.map((place, i) => [place, flat[i]]), [squeeze, goal.squeeze]],
    values: [[`${table}.guide.offset`, goal.offsets.map((each) => [...each])], [`${table}.guide.squeeze`, goal.squeeze]],
  };
}
function writeHandles() {
  const box = find("handles");
  run.handles.forEach((each, hand) => {
    const group = document.createElement("fieldset"); box.append(group);
    text(group, "legend", each.name);
    const buttons = each.fingers.length > 1 ? [null, ...each.fingers.keys()] : [0];
    for (const own of buttons) {
      const button = text(group, "button", own === null ? "whole hand" : story.fingers[each.fingers[own]].name);
      button.type = "button"; button.title = "Arrow keys move it by 1 mm; page up and down along the third axis; Home puts it back";
      button.addEventListener("keydown", (event) => {
        const by = { ArrowLeft: [-1, 0, 0], ArrowRight: [1, 0, 0], ArrowUp: [0, 1, 0], ArrowDown: [0, -1, 0], PageUp: [0, 0, 1], PageDown: [0, 0, -1], Home: [0, 0, 0] }[event.key];
        if (!by) return;
        event.preventDefault(); event.stopPropagation();
        const now = run.goals[hand].offsets[own ?? 0];
        moveTo(hand, own, event.key === "Home" ? by : now.map((x, a) => x + STEP * by[a]));
      });
    }
    const label = text(group, "label", "squeeze [mm]"), slider = document.createElement("input");
    Object.assign(slider, { type: "range", min: -10, max: 10, step: 0.1, value: 0 });
    const value = text(label, "b", "0.0"), show = () => { value.textContent = Number(slider.value).toFixed(1); };
    slider.addEventListener("shown", show);
    slider.addEventListener("input", () => { run.goals[hand].squeeze = Number(slider.value) / 1000; show(); tell("write", writtenGoal(hand)); });
    label.append(slider);
  });
}
// The finger under a pointer: the nearest fingertip within reach of a touch.
function fingerAt(x, y) {
  if (!run || !F || !seen) return -1;
  const now = frameAt(time), box = find("scene").getBoundingClientRect();
  let best = -1, least = Infinity;
  now.fingertips.forEach((tip, i) => {
    if (!finite(tip) || !handOf(i) || [...drags.values()].some((drag) => drag.finger === i)) return;
    const mark = project(tip, seen, box.width, box.height), away = Math.hypot(mark[0] - x, mark[1] - y) - story.fingers[i].radius * seen.pixels;
    if (away < 26 && away < least) { least = away; best = i; }
  });
  return best;
}
function grab(event, canvas) {
  const box = canvas.getBoundingClientRect(), finger = fingerAt(event.clientX - box.left, event.clientY - box.top);
  if (finger < 0) return false;
  const [hand, own] = handOf(finger);
  drags.set(event.pointerId, { finger, hand, own: event.shiftKey ? null : own, from: [event.clientX, event.clientY], before: [...run.goals[hand].offsets[own]] });
  return true;
}
function drag(event) {
  const each = drags.get(event.pointerId);
  if (!each) return false;
  const [dx, dy] = [event.clientX - each.from[0], event.clientY - each.from[1]], { right, up } = cameraAxes();
  const by = add(times(dx / seen.pixels, right), times(-dy / seen.pixels, up));
  moveTo(each.hand, each.own, each.before.map((x, a) => x + by[a]));
  return true;
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
