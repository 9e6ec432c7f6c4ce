// A page with a run: frames come from a source, one after the other, and sliders and hands lead the run.
const run = story.run && { again: 0, sliders: [], handles: [], presets: [], ...story.run };
const state = { going: false, ended: "", tick: 0, recorded: 0, recording: false, slow: 0 };
const STEP = 0.001; // [m] of an arrow key
const lineCount = run ? story.charts.reduce((sum, chart) => sum + chart.lines.length, 0) : 0;
const frameWidth = 13 * n + 7 * story.objects.length + 3 * lineCount;
let follow = true, drags = new Map(), source = null; // the source is opened by own.js or live.js

function tell(act, data = {}) { source.tell(act, data); }

function startRun() {
  run.values = run.sliders.map((each) => each.value);
  resetGoals();
  find("live").hidden = find("restart").hidden = find("record").hidden = false;
  find("restart").addEventListener("click", () => source.restart(false));
  source = openSource();
  writeSliders(); writeHandles();
}
function resetGoals() {
  run.goals = run.handles.map((each) => ({ offsets: each.fingers.map(() => Array(story.dimensions).fill(0)), squeeze: 0 }));
  showSqueezes();
}

// Frames ---------------------------------------------------------------------------------------------------------------
const strengths = new Float32Array(run ? MINUTE : 0); // [N] the greatest force of each frame
function append(values) {
  makeRoom();
  strengths[F] = 0;
  for (let i = 7 * n; i < 13 * n; i += 3) { const force = Math.hypot(values[i], values[i + 1], values[i + 2]); if (force > strengths[F]) strengths[F] = force; }
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
function forget() { F = 0; origin = 0; time = 0; for (const chart of charts) chart.range = [0, 0.1]; }
// What a source has told is shown: its frames, whether it goes on, and what is wrong.
function shown(alarm = state.ended) {
  if (playing !== state.going) { playing = state.going; showPlaying(); }
  find("banner").textContent = alarm; find("banner").hidden = !alarm;
  find("record").textContent = state.recording ? "■ Stop recording" : "● Record";
  if (follow) time = lastTime();
  rescale(); redraw();
}
// The force of the longest arrow: above the greatest of the last ten seconds, and changed when that is far from it.
function rescale() {
  let most = 0;
  for (let k = Math.max(0, F - Math.ceil(10 / story.step)); k < F; k++) most = Math.max(most, strengths[k]);
  const longest = story.arrow.longest * story.extent, now = longest / story.arrow.scale;
  if (most > 0 && !(most <= now && most > now / 5)) story.arrow.scale = longest / (2 * round125(most));
}

// What stands beside it ------------------------------------------------------------------------------------------------
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


function writeSliders() {
  const box = find("sliders");
  run.sliders.forEach((each, i) => {
    const label = text(box, "label", each.unit ? `${each.label} [${each.unit}]` : each.label), slider = document.createElement("input"), number = document.createElement("input"), mark = document.createElement("span"), band = document.createElement("i");
    slider.type = "range"; number.type = "number"; label.className = "number"; number.step = "any";
    slider.setAttribute("aria-label", each.label);
    mark.className = "mark"; band.className = "band";
    const share = (value) => `${(100 * (value - each.least)) / (each.most - each.least)}%`;
    if (each.margin?.length) band.style.backgroundImage = each.margin.map(([low, high]) => `linear-gradient(to right, transparent ${share(low)}, var(--unstable) ${share(low)}, var(--unstable) ${share(high)}, transparent ${share(high)})`).join(",");
    each.show = () => {
      const value = run.values[i], [words, bad] = source.mark(each, value);
      for (const input of [slider, number]) { input.min = each.least; input.max = each.most; }
      slider.step = each.stops ? each.stops[1] - each.stops[0] : each.step;
      slider.value = value;
      if (document.activeElement !== number) number.value = plain(value);
      label.classList.toggle("unstable", bad);
      mark.textContent = words;
    };
    each.set = (value) => {
      if (Number.isFinite(value)) source.set(i, clamp(value, each.least, each.most));
      number.value = plain(run.values[i]);
      each.show();
    };
    slider.addEventListener("input", () => each.set(Number(slider.value)));
    number.addEventListener("change", () => each.set(number.value === "" ? NaN : Number(number.value)));
    label.append(slider, number, mark, band); number.value = plain(each.value); each.show();
  });
  for (const preset of run.presets) {
    const button = text(find("presets"), "button", preset.name);
    button.type = "button";
    button.addEventListener("click", () => {
      for (const [i, value] of preset.values) run.sliders[i].set(value);
      if (state.ended) source.restart(false);
    });
  }
}

// Hands: a fingertip is dragged, by mouse or by touch, or moved by keys; with shift all fingers of its hand.
function handOf(finger) {
  const hand = run.handles.findIndex((each) => each.fingers.includes(finger));
  return hand < 0 ? null : [hand, run.handles[hand].fingers.indexOf(finger)];
}
function moveBy(hand, own, by, before = run.goals[hand].offsets) {
  const goal = run.goals[hand], limit = run.handles[hand].farthest;
  goal.offsets = goal.offsets.map((now, i) => (own === null || own === i ? before[i].map((x, a) => clamp(x + by[a], -limit, limit)) : now));
  source.lead(hand, own);
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
        const home = each.fingers.map(() => Array(story.dimensions).fill(0));
        moveBy(hand, own, times(STEP, by), event.key === "Home" ? home : undefined);
      });
    }
    if (!each.squeezes) return;
    const label = text(group, "label", "squeeze [mm]"), slider = document.createElement("input"), [min, max, step] = each.squeezes;
    Object.assign(slider, { type: "range", min, max, step, value: 0, title: "In addition to the scene's; below zero the hand opens" });
    const value = text(label, "b", "");
    each.showSqueeze = () => { slider.value = 1000 * run.goals[hand].squeeze; value.textContent = (1000 * run.goals[hand].squeeze).toFixed(1); };
    slider.addEventListener("input", () => { run.goals[hand].squeeze = Number(slider.value) / 1000; each.showSqueeze(); source.squeeze(hand); });
    label.append(slider); each.showSqueeze();
  });
}
function showSqueezes() { for (const each of run.handles) each.showSqueeze?.(); }
// The finger under a pointer: the nearest fingertip within reach of a touch.
function fingerAt(x, y) {
  if (!F || !seen) return -1;
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
  drags.set(event.pointerId, { finger, hand, own: event.shiftKey ? null : own, from: [event.clientX, event.clientY], before: run.goals[hand].offsets });
  return true;
}
function drag(event) {
  const each = drags.get(event.pointerId);
  if (!each) return false;
  const [dx, dy] = [event.clientX - each.from[0], event.clientY - each.from[1]], { right, up } = cameraAxes();
  const by = add(times(dx / seen.pixels, right), times(-dy / seen.pixels, up));
  moveBy(each.hand, each.own, by, each.before);
  return true;
}

