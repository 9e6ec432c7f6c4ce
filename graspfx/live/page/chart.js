// Strip charts of what squeezes each object and what pushes it: of each frame the least and the greatest of its ticks.
const SPAN = 10; // [s]
class Chart {
  constructor(box, number) {
    this.data = story.charts[number];
    const values = story.run ? () => empty(1) : unpack;
    this.lines = this.data.lines.map((each) => ({ ...each, now: values(each.now), low: values(each.low), high: values(each.high) }));
    this.canvas = box.querySelector("canvas");
    this.figures = box.querySelector(".figures");
    this.range = story.run ? [0, 0.1] : this.extremes(0);
  }
  // The range of all values from a frame on, with room at the rim.
  extremes(from) {
    let least = 0, most = 0;
    for (const { low, high } of this.lines) for (let k = from; k < F; k++) {
      if (low[k] < least) least = low[k];
      if (high[k] > most) most = high[k];
    }
    const room = 0.06 * (most - least || 1);
    return [least < 0 ? least - room : 0, most + room];
  }
  // Times that are seen: all of a recording; of a page that runs the last ten seconds, in a range that only grows.
  get window() {
    if (!story.run) return [origin, lastTime()];
    return [Math.max(origin, lastTime() - SPAN), Math.max(lastTime(), origin + SPAN)];
  }
  get first() { return story.run ? Math.max(0, F - 1 - Math.ceil(SPAN / story.step)) : 0; }
  // The place of a value and of a time, in CSS pixels.
  places(width, height) {
    const [low, high] = this.range, [from, to] = this.window, left = 44, right = width - 8, top = 6, bottom = height - 20;
    return {
      left, right, top, bottom,
      x: (time) => left + ((right - left) * (time - from)) / (to - from || 1),
      time: (x) => from + ((to - from) * (x - left)) / (right - left),
      y: (value) => bottom - ((bottom - top) * (value - low)) / (high - low),
    };
  }
  // Lines are drawn once for each size of the window and each look; at a time only the cursor is.
  show(time) {
    const box = this.canvas.getBoundingClientRect(), ratio = window.devicePixelRatio || 1;
    if (!box.width) return;
    const look = getComputedStyle(document.documentElement), ink = look.getPropertyValue("--ink"), line = look.getPropertyValue("--grid");
    if (story.run) {
      const [low, high] = this.extremes(this.first);
      this.range = [Math.min(this.range[0], low), Math.max(this.range[1], high)];
    }
    const at = this.places(box.width, box.height), key = [box.width, box.height, ratio, ink, story.run && F && lastTime()].join();
    if (key !== this.key) {
      this.lasting = document.createElement("canvas");
      this.canvas.width = this.lasting.width = Math.round(box.width * ratio);
      this.canvas.height = this.lasting.height = Math.round(box.height * ratio);
      this.key = key;
      const once = this.lasting.getContext("2d");
      once.scale(ratio, ratio);
      this.lines_and_scales(once, at, box, ink, line);
    }
    const draw = this.canvas.getContext("2d");
    draw.setTransform(1, 0, 0, 1, 0, 0);
    draw.clearRect(0, 0, this.canvas.width, this.canvas.height);
    draw.drawImage(this.lasting, 0, 0);
    draw.scale(ratio, ratio);
    stroke(draw, ink, 1.5, [], [[at.x(time), at.top - 6], [at.x(time), at.bottom + 3]]);
    this.say(time);
  }
  lines_and_scales(draw, at, box, ink, line) {
    draw.font = "11px system-ui, sans-serif"; draw.lineJoin = "round";
    draw.textAlign = "right"; draw.textBaseline = "middle";
    for (const value of ticks(...this.range, 4)) {
      stroke(draw, line, 1, [], [[at.left, at.y(value)], [at.right, at.y(value)]]);
      draw.fillStyle = ink; draw.fillText(plain(value), at.left - 5, at.y(value));
    }
    draw.textBaseline = "top";
    for (const value of ticks(...this.window, box.width / 90)) {
      stroke(draw, line, 1, [], [[at.x(value), at.top], [at.x(value), at.bottom]]);
      draw.textAlign = value === 0 ? "left" : at.x(value) > at.right - 10 ? "right" : "center";
      draw.fillStyle = ink; draw.fillText(value === 0 ? "0 s" : plain(value), at.x(value), at.bottom + 4);
    }
    stroke(draw, ink, 1, [], [[at.left, at.y(0)], [at.right, at.y(0)]], 0.5);
    for (const each of this.lines) this.curve(draw, { ...each, colour: each.colour || ink }, at);
    for (const change of story.changes) stroke(draw, ink, 1, [3, 3], [[at.x(change.time), at.top], [at.x(change.time), at.bottom]], 0.7);
    for (const fault of story.faults) stroke(draw, "#b00020", 2, [], [[at.x(fault.time), at.top], [at.x(fault.time), at.bottom]]);
  }
  // The line goes through the frames; where ticks between two of them go beyond it, a band shows how far.
  curve(draw, { now, low, high, colour, width, dashes }, at) {
    const x = (k) => at.x(origin + k * story.step);
    draw.fillStyle = colour; draw.globalAlpha = 0.3;
    for (let k = this.first; k < F; k++) {
      const a = now[k], b = now[Math.min(k + 1, F - 1)], wide = Math.max(x(Math.min(k + 1, F - 1)) - x(k), 1);
      const above = at.y(Math.max(a, b)) - at.y(high[k]), below = at.y(low[k]) - at.y(Math.min(a, b));
      if (above > 2) draw.fillRect(x(k), at.y(high[k]), wide, above);
      if (below > 2) draw.fillRect(x(k), at.y(low[k]) - below, wide, below);
    }
    draw.globalAlpha = 1;
    let path = [];
    const end = () => { if (path.length > 1) stroke(draw, colour, width, dashes, path); path = []; };
    for (let k = this.first; k < F; k++) Number.isNaN(now[k]) ? end() : path.push([x(k), at.y(now[k])]);
    end();
  }
  say(time) {
    const k = clamp(Math.floor((time - origin) / story.step + 1e-6), 0, Math.max(F - 1, 0));
    this.lines.forEach((each, i) => {
      const value = each.now[k];
      this.figures.children[i].querySelector("b").textContent = !F || Number.isNaN(value) ? "–" : `${value.toFixed(3).replace(/^-(0\.0+)$/, "$1")} ${this.data.unit}`;
    });
  }
}

function stroke(draw, colour, width, dashes, points, alpha = 1) {
  draw.globalAlpha = alpha; draw.strokeStyle = colour; draw.lineWidth = width; draw.setLineDash(dashes.map((each) => each * width));
  draw.beginPath(); points.forEach(([x, y], i) => (i ? draw.lineTo(x, y) : draw.moveTo(x, y))); draw.stroke();
  draw.globalAlpha = 1; draw.setLineDash([]);
}
// A length of 1, 2 or 5 times a power of ten, not above a number.
function round125(x) {
  const power = 10 ** Math.floor(Math.log10(x)), m = x / power;
  return (m >= 5 ? 5 : m >= 2 ? 2 : 1) * power;
}
function ticks(low, high, most) {
  if (!(high > low)) return [low];
  let step = round125((high - low) / Math.max(most, 1));
  while ((high - low) / step > most + 1) step = round125(step * 2.5);
  const list = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high * (1 + 1e-9); i++) list.push(i * step);
  return list;
}
const plain = (x) => String(Number(x.toPrecision(4)));
