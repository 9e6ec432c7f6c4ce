// The source of a page of a live run: the program that serves it ticks, and a WebSocket brings frames and takes orders.
const PAUSE = 300; // [ms] during which what the page ordered itself counts, not what the program tells
const touched = { sliders: run.sliders.map(() => -PAUSE), hands: run.handles.map(() => -PAUSE) };
const QUIET = { again: 0, going: false, alarm: "", question: "", lines: [], remark: "", recording: false, recorded: false, sliders: [], hands: [], margins: null };
let line = null, number = -1, latest = null;
function openSource() {
  connect();
  find("speed").closest("label").hidden = true;
  if (run.hardware) for (const id of ["play", "back", "forth", "restart"]) find(id).hidden = true;
  document.body.classList.toggle("asks", Boolean(run.ask));
  find("restart").title = "The scene from its beginning, with these values";
  find("record").title = "The scene from its beginning, recorded to a file";
  find("record").addEventListener("click", () => tell(state.recording ? "stop" : "record"));
  find("opened").addEventListener("click", () => window.open("/recording", "_blank", "noopener"));
  for (const { key, text: words } of run.ask ?? []) {
    const button = text(find("answers"), "button", words);
    button.type = "button";
    button.addEventListener("click", () => tell("answer", { key }));
  }
  const now = () => performance.now();
  return {
    tell(act, data) { if (line?.readyState === WebSocket.OPEN) line.send(JSON.stringify({ act, ...data })); },
    restart() { tell("reset"); },
    set(slider, value) { run.values[slider] = value; touched.sliders[slider] = now(); tell("set", { slider, value }); },
    lead(hand, own) {
      touched.hands[hand] = now();
      const { offsets } = run.goals[hand], isOne = offsets.every((each) => String(each) === String(offsets[0]));
      for (const finger of own !== null ? [own] : isOne ? [null] : offsets.keys()) tell("lead", { hand, finger, offset: offsets[finger ?? 0] });
    },
    squeeze(hand) { touched.hands[hand] = now(); tell("squeeze", { hand, value: run.goals[hand].squeeze }); },
    mark: () => ["", false],
  };
}
function connect() {
  line = new WebSocket(`ws://${location.host}/live`);
  line.binaryType = "arraybuffer";
  line.onmessage = ({ data }) => (typeof data === "string" ? onState({ ...QUIET, ...JSON.parse(data) }) : onFrames(data));
  line.onclose = () => {
    state.going = false;
    shown("The program that runs this scene does not answer: it has ended, or is out of reach");
    setTimeout(connect, 1000);
  };
}
// Frames have numbers from the beginning of a run; the last one may come again, with more of its ticks.
function onFrames(data) {
  const [its, first, count] = new Float64Array(data, 0, 3), frames = new Float32Array(data, 24);
  if (its !== number) { number = its; forget(); resetGoals(); }
  for (let k = 0; k < count; k++) {
    const values = frames.subarray(k * frameWidth, (k + 1) * frameWidth), next = Math.round(origin / story.step) + F, at = first + k;
    if (F && at < next - 1) continue;
    if (F && at === next - 1) F -= 1;
    else if (!F || at > next + MINUTE / 4) { forget(); origin = at * story.step; }
    else if (at > next) {
      const gap = latest.slice(); // frames that this page has missed: it stood still
      gap.fill(NaN, frameWidth - 3 * lineCount);
      for (let i = next; i < at; i++) append(gap);
    }
    append(values); latest = values;
  }
  if (latest) shown(state.alarm);
}
function onState(told) {
  if (told.again !== run.again) { location.reload(); return; } // the page of another scene
  Object.assign(state, told);
  find("question").textContent = told.question; find("ask").hidden = !told.question && !run.ask?.length;
  find("told").textContent = told.lines.join(", ");
  find("remark").textContent = told.remark;
  find("opened").hidden = !told.recorded;
  const now = performance.now();
  told.sliders.forEach(([value, least, most, step], i) => {
    const each = run.sliders[i];
    Object.assign(each, { least, most, step });
    if (now - touched.sliders[i] > PAUSE) run.values[i] = value;
    each.show?.();
  });
  told.hands.forEach((goal, hand) => { if (!drags.size && now - touched.hands[hand] > PAUSE) run.goals[hand] = goal; });
  showSqueezes(); sayMargins(told.margins);
  shown(told.alarm);
}
// The certificate of the present values: what it says, and each margin as a bar, with a mark where stability is lost.
function sayMargins(margins) {
  const box = find("margins"), key = JSON.stringify(margins);
  if (box.dataset.key === key) return;
  box.dataset.key = key;
  box.replaceChildren();
  if (!margins) return;
  for (const { kind, words, note } of margins.boxes) {
    const each = text(box, "p", "", `box ${kind}`);
    text(each, "b", words); if (note) text(each, "span", ` ${note}`);
  }
  for (const { name, margin, share, kind, words } of margins.rows) {
    const row = text(box, "div", "", `margin ${kind}${margins.faint ? " faint" : ""}`);
    row.title = words;
    text(row, "span", name); text(row, "b", margin);
    const bar = text(row, "div", "", "bar"), filled = text(bar, "i", ""), mark = text(bar, "u", "");
    filled.style.width = `${100 * share}%`; mark.style.left = `${100 * margins.mark}%`;
  }
}
