// The page: what time it is, who turns the picture, and what is written beside it.
const reduced = window.matchMedia("(prefers-reduced-motion: reduce)");
let time = 0, playing = false, last = 0, speed = 1, due = false, space = null, seen = null;

function text(parent, tag, words, kind = "") {
  const each = document.createElement(tag);
  each.textContent = words; // never as HTML: names are other people's
  if (kind) each.className = kind;
  parent.append(each);
  return each;
}

function colour(name) {
  return rgb(getComputedStyle(document.documentElement).getPropertyValue(name).trim());
}

// Everything is drawn once for each change, and nothing while nothing changes.
function redraw() {
  if (due) return;
  due = true;
  requestAnimationFrame((stamp) => {
    due = false;
    if (playing && !run) {
      time = Math.min(time + (speed * Math.min(stamp - last, 100)) / 1000, lastTime());
      last = stamp;
      if (time >= lastTime()) play(false); else redraw();
    }
    show();
  });
}

function show() {
  if (!F) return; // a run that has no tick yet
  time = Math.max(time, origin);
  const now = frameAt(time), box = find("scene").getBoundingClientRect(), ratio = Math.min(window.devicePixelRatio || 1, 2);
  if (space && box.width) {
    const [width, height] = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
    const canvas = find("space");
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    if (run && run.live && seen && camera.follows && !drags.size) keepInView(now, box.width, box.height);
    seen = space.show(now, box.width, box.height, colour("--sky"), colour("--grid"));
    overlay(now, box.width, box.height);
  }
  charts.forEach((each) => each.show(time));
  const slider = find("slider");
  slider.min = origin; slider.max = lastTime(); slider.value = time; slider.setAttribute("aria-valuetext", `${time.toFixed(3)} seconds`);
  find("clock").textContent = run ? `${time.toFixed(2)} s` : `${time.toFixed(3)} s of ${lastTime().toFixed(2)} s`;
  sayValues();
}

// Names, scales and axes over the picture.
function overlay(now, width, height) {
  const canvas = find("overlay"), ratio = window.devicePixelRatio || 1, draw = canvas.getContext("2d");
  canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio);
  draw.scale(ratio, ratio);
  const look = getComputedStyle(document.documentElement), ink = look.getPropertyValue("--ink"), sky = look.getPropertyValue("--sky");
  draw.font = "600 12px system-ui, sans-serif"; draw.textAlign = "center"; draw.textBaseline = "middle";
  const halo = (words, x, y, fill) => {
    draw.strokeStyle = sky; draw.lineWidth = 4; draw.lineJoin = "round"; draw.strokeText(words, x, y);
    draw.fillStyle = fill; draw.fillText(words, x, y);
  };
  if (find("names").checked) names(draw, halo, now, width, height, ink);
  const [ox, oy] = [34, height - 34];
  [EAST, [0, 1, 0], [0, 0, 1]].forEach((axis, i) => {
    if (story.dimensions <= i) return;
    const [x, y] = [22 * dot(axis, seen.right), -22 * dot(axis, seen.up)];
    draw.setLineDash([]);
    stroke(draw, ink, 1.5, [], [[ox, oy], [ox + x, oy + y]]);
    const s = Math.max(Math.hypot(x, y), 6);
    halo("xyz"[i], ox + x + (9 * x) / s, oy + y + (9 * y) / s, ink);
  });
  scales(draw, ink, halo, width, height);
}
// Beyond the outermost end of a finger's arrows, away from its object; below the name before it where they would meet.
function names(draw, halo, now, width, height, ink) {
  const ends = arrows(now, seen), boxes = [];
  story.fingers.forEach((finger, i) => {
    const tip = now.fingertips[i], thing = now.objects[finger.object];
    if (!finite(tip)) return;
    const middle = project(thing && finite(thing.position) ? thing.position : camera.target, seen, width, height);
    const far = ([x, y]) => Math.hypot(x - middle[0], y - middle[1]);
    const marks = [tip, ...ends.filter((each) => each.finger === i).flatMap((each) => [each.tail, each.tip])]
      .map((point) => project(point, seen, width, height)).filter((mark) => mark[2] > 0);
    if (!marks.length) return;
    const mark = marks.reduce((a, b) => (far(b) > far(a) + 1 ? b : a)), s = far(mark) || 1;
    const words = story.fingers.length > 8 ? String(i) : finger.name, half = 0.5 * draw.measureText(words).width;
    const r = (mark === marks[0] ? finger.radius * seen.pixels : 0) + 7, [dx, dy] = [(mark[0] - middle[0]) / s, (mark[1] - middle[1]) / s];
    let x = mark[0] + dx * (r + half), y = mark[1] + dy * (r + 6);
    if (Math.abs(dx) > 0.5) x = mark[0] + Math.sign(dx) * (Math.abs(dx) * r + half);
    for (const box of boxes) if (Math.abs(box[0] - x) < box[2] + half && Math.abs(box[1] - y) < 14) y = box[1] + (y >= box[1] ? 14 : -14);
    boxes.push([x, y, half]);
    halo(words, x, y, ink);
  });
}
function scales(draw, ink, halo, width, height) {
  const metres = round125(90 / seen.pixels), length = metres * seen.pixels, y = height - 16, right = width - 16;
  stroke(draw, ink, 2, [], [[right - length, y], [right, y]]);
  halo(`${plain(1000 * metres)} mm`, right - 0.5 * length, y - 11, ink);
  if (!(story.arrow.scale > 0)) return;
  const newtons = round125(90 / (story.arrow.scale * seen.pixels)), arrow = newtons * story.arrow.scale * seen.pixels;
  const x = right - length - 28;
  if (x - arrow < 90) return;
  stroke(draw, ink, 2, [], [[x - arrow, y], [x - 5, y]]);
  draw.beginPath(); draw.moveTo(x, y); draw.lineTo(x - 8, y - 4); draw.lineTo(x - 8, y + 4); draw.fillStyle = ink; draw.fill();
  halo(`${plain(newtons)} N`, x - 0.5 * arrow, y - 11, ink);
}

function play(on) {
  if (run) {
    if (run.live && !follow) { follow = true; time = lastTime(); showPlaying(); redraw(); } // back to the present, from what was a moment ago
    else if (!run.hardware) { follow = true; tell(on ? "run" : "pause"); }
    return;
  }
  if (on && time >= lastTime() - 1e-9) time = origin;
  playing = on && F > 1; last = performance.now();
  showPlaying(); redraw();
}
function showPlaying() {
  const button = find("play"), does = run && run.live && !follow ? "Back to the present" : run ? "Run" : "Play", on = playing && (!run || follow);
  button.textContent = on ? "❚❚" : "▶";
  button.setAttribute("aria-label", on ? "Pause" : does);
  button.title = on ? "Pause (space)" : `${does} (space)`;
}
function go(to) {
  time = clamp(to, origin, lastTime());
  if (run) { follow = time >= lastTime() - 1e-9; if (!follow && playing && !run.live) tell("pause"); showPlaying(); }
  redraw();
}
function step(frames) {
  if (run && frames > 0 && time >= lastTime() - 1e-9) { if (run.hardware) return; follow = true; tell("step", { count: frames * run.frames }); return; }
  if (!run || !run.live) play(false);
  go((Math.round((time - origin) / story.step) + frames) * story.step + origin);
}

// Values of the scene, with those that changed in mid-run as they are at this time.
const cells = [];
function writeValues() {
  const table = find("values");
  if (run) find("stated").textContent = "Values at the start";
  for (const row of story.values) {
    const line = document.createElement("tr");
    const name = text(line, "th", row.label); name.scope = "row"; name.title = row.key;
    const cell = text(line, "td", "");
    table.append(line);
    cells.push({ row, cell, words: "" });
  }
}
function sayValues() {
  for (const each of cells) {
    const { row } = each;
    let now = row.values[0];
    for (const value of row.values) if (value[0] <= time + 1e-9) now = value;
    const words = row.unit ? `${now[1]} ${row.unit}` : now[1];
    if (words !== each.words) { each.cell.textContent = each.words = words; each.cell.className = now[0] > 0 ? "changed" : ""; }
  }
}

function writeLegend() {
  const list = find("legend"), item = (kind, fill, words) => {
    const line = document.createElement("li"), mark = document.createElement("span");
    mark.className = kind; mark.style.setProperty("--fill", fill); mark.setAttribute("aria-hidden", "true");
    line.append(mark, document.createTextNode(words)); list.append(line);
  };
  if (story.internal || (run && !story.bare)) {
    item("arrow", story.colours.internal, "internal force: squeezes");
    item("arrow", story.colours.external, "external force: pushes");
  }
  for (const [name, fill, words] of story.contacts_states) if (story.states_seen.includes(name)) item("ball", fill, words);
}

function writeCharts() {
  const box = find("charts");
  story.charts.forEach((chart, number) => {
    const one = document.createElement("figure");
    const head = document.createElement("figcaption");
    text(head, "span", chart.title, "name");
    const figures = document.createElement("span"); figures.className = "figures";
    for (const line of chart.lines) {
      const each = document.createElement("span");
      const mark = document.createElement("i"); mark.style.borderTop = `${line.width}px ${line.dashes.length ? (line.dashes[0] < 2 ? "dotted" : "dashed") : "solid"} ${line.colour || "currentColor"}`;
      each.append(mark, document.createTextNode(`${line.name} `)); text(each, "b", "–");
      figures.append(each);
    }
    head.append(figures); one.append(head);
    const canvas = document.createElement("canvas");
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `Chart over time of ${chart.lines.map((line) => line.name).join(", ")}, in ${chart.unit === "N" ? "newtons" : "millimetres"}; click to go to a time`);
    one.append(canvas); box.append(one);
    const made = new Chart(one, number), reach = (event) => {
      const place = canvas.getBoundingClientRect(), at = made.places(place.width, place.height);
      go(at.time(event.clientX - place.left));
    };
    canvas.addEventListener("pointerdown", (event) => { if (!run) play(false); canvas.setPointerCapture(event.pointerId); reach(event); });
    canvas.addEventListener("pointermove", (event) => { if (canvas.hasPointerCapture(event.pointerId)) reach(event); });
    charts.push(made);
  });
}

// One finger or button turns the picture; two fingers, or the right button or shift, shift it; pinch and wheel zoom.
function watchHands() {
  const canvas = find("space"), down = new Map();
  const turn = (dx, dy) => {
    camera.azimuth -= 0.008 * dx;
    camera.elevation = clamp(camera.elevation + 0.008 * dy, -1.55, 1.55);
  };
  const shift = (dx, dy) => {
    if (!seen) return;
    const { right, up } = cameraAxes();
    camera.follows = false;
    camera.target = add(camera.target, add(times(-dx / seen.pixels, right), times(dy / seen.pixels, up)));
  };
  const zoom = (by) => { camera.zoom = clamp(camera.zoom * by, 0.05, 20); };
  canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); if (run && grab(event, canvas)) return; down.set(event.pointerId, [event.clientX, event.clientY]); });
  for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) canvas.addEventListener(end, (event) => { down.delete(event.pointerId); drags.delete(event.pointerId); });
  canvas.addEventListener("pointermove", (event) => {
    if (run && drag(event)) return;
    const before = down.get(event.pointerId), now = [event.clientX, event.clientY];
    if (!before) return;
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    if (down.size === 2) {
      const other = [...down].find(([id]) => id !== event.pointerId)[1];
      const [a, b] = [before, now].map((each) => Math.hypot(each[0] - other[0], each[1] - other[1]));
      if (b > 0) zoom(a / b);
      shift(dx / 2, dy / 2);
    } else if (event.shiftKey || event.buttons & 6) shift(dx, dy);
    else turn(dx, dy);
    down.set(event.pointerId, now);
    redraw();
  });
  canvas.addEventListener("wheel", (event) => { event.preventDefault(); zoom(Math.exp(0.0012 * clamp(event.deltaY, -300, 300))); redraw(); }, { passive: false });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("keydown", (event) => {
    const move = { ArrowLeft: [-12, 0], ArrowRight: [12, 0], ArrowUp: [0, -12], ArrowDown: [0, 12] }[event.key];
    if (move && event.altKey) { turn(...move); event.preventDefault(); event.stopPropagation(); redraw(); }
  });
}
function watchKeys() {
  document.addEventListener("keydown", (event) => {
    const { target, key } = event;
    if (event.ctrlKey || event.metaKey || event.altKey || target.tagName === "SELECT" || target.type === "number" || (target.type === "range" && target.id !== "slider")) return;
    if (key === " " && (target.tagName === "BUTTON" || target.tagName === "SUMMARY" || target.type === "checkbox")) return;
    const act = {
      " ": () => play(!playing), ArrowLeft: () => step(event.shiftKey ? -10 : -1), ArrowRight: () => step(event.shiftKey ? 10 : 1),
      Home: () => go(origin), End: () => go(lastTime()), r: () => { resetCamera(); redraw(); },
    }[key];
    if (act) { event.preventDefault(); act(); }
  });
}

const charts = [];
function start() {
  document.title = `${story.title} – GraspFX`;
  find("title").textContent = story.title;
  find("facts").textContent = story.facts;
  document.body.classList.toggle("bare", Boolean(story.bare));
  for (const [words, address] of story.links ?? []) { const link = text(find("facts"), "a", words); link.href = address; }
  for (const note of story.notes) text(find("notes"), "li", note);
  find("notes").hidden = !story.notes.length;
  for (const [name, words] of story.about) { text(find("about"), "dt", name); text(find("about"), "dd", words); }
  const slider = find("slider");
  slider.step = story.step;
  resetCamera(); writeLegend(); writeValues(); writeCharts();
  const canvas = find("space");
  const begin = () => {
    try { space = new Space(canvas); } catch (error) { space = null; }
    find("missing").hidden = space !== null;
  };
  begin();
  canvas.addEventListener("webglcontextlost", (event) => { event.preventDefault(); space = null; });
  canvas.addEventListener("webglcontextrestored", () => { begin(); redraw(); });
  canvas.setAttribute("aria-label", story.description);
  find("play").addEventListener("click", () => play(!playing));
  find("back").addEventListener("click", () => step(-1));
  find("forth").addEventListener("click", () => step(1));
  find("reset").addEventListener("click", () => { resetCamera(); redraw(); });
  find("names").addEventListener("change", redraw);
  find("speed").addEventListener("change", (event) => { speed = Number(event.target.value); if (run) source.tell("speed", { speed }); });
  slider.addEventListener("input", () => { if (!run) play(false); go(Number(slider.value)); });
  new ResizeObserver(redraw).observe(find("scene"));
  if (charts.length) new ResizeObserver(redraw).observe(find("charts"));
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  watchHands(); watchKeys();
  if (run) { startRun(); return; }
  const asked = /^#t=([0-9.]+)$/.exec(location.hash);
  go(asked ? Number(asked[1]) : origin); play(false); show();
}
start();

// For whoever wants the numbers, in the browser's console.
window.graspfx = {
  story, frame, frameAt, go, play, arrows: () => arrows(frameAt(time), seen),
  project: (point) => project(point, seen, find("scene").clientWidth, find("scene").clientHeight),
  // The place in a chart, in CSS pixels of the window, of a value at a time.
  chartPlace: (number, value, at) => {
    const box = charts[number].canvas.getBoundingClientRect(), places = charts[number].places(box.width, box.height);
    return [box.left + places.x(at), box.top + places.y(value)];
  },
  get time() { return time; }, get playing() { return playing; }, get frames() { return F; }, camera, run, state,
};
