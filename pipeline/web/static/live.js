// The page of a run.

import { distanceColours, floats, inflated } from "./codes.js";
import { watch } from "./connection.js";
import { MapView } from "./map_view.js";
import { CameraView, DepthView, LocalView } from "./pictures.js";

const OLD = 1.0; // s: a picture that is worth a word
const LINES = { open: "live", lost: "connection lost", refused: "not let in" };
const PHASES = { waiting: "waiting for the robot", finishing: "finishing the map", ended: "finished", failed: "failed" };

const element = (id) => document.getElementById(id);
const map = new MapView(element("map"), (text) => {
  element("measured").value = text;
  element("measured").hidden = !text;
});
const camera = new CameraView(element("camera"));
const depth = new DepthView(element("depth"));
const local = new LocalView(element("local"));
let line = "lost", run = { phase: "waiting" }, picture = null;

/** An element with text, and a class where it is given. */
function made(name, text, kind = "") {
  const node = document.createElement(name);
  node.textContent = text;
  if (kind) node.className = kind;
  return node;
}

function showRun(values) {
  if (run.id && run.id !== values.id) return location.reload(); // another run
  run = values;
  element("name").textContent = run.name;
  document.title = `${run.name}: ${PHASES[run.phase] ?? "beemap"}`;
  for (const card of ["camera-card", "depth-card"]) element(card).hidden = !run.cameras;
  const metres = (value) => (value ? `${value.toFixed(1)} m` : "");
  element("half").textContent = metres(run.farthest / 2);
  element("farthest").textContent = metres(run.farthest);
  element("checks").replaceChildren(
    ...run.checks.map(([name, wrong]) => made("li", wrong || name, wrong ? "bad" : "")));
  element("figures").replaceChildren(...run.figures.map(([name, value]) => {
    const pair = document.createElement("div");
    pair.append(made("dt", name), made("dd", value));
    return pair;
  }));
  element("notes").replaceChildren(...run.notes.toReversed().map(([time, text]) => {
    const note = document.createElement("li");
    note.append(made("time", time), text);
    return note;
  }));
  element("nothing").hidden = run.notes.length > 0;
  showLine();
}

/** How the line and the run are, and what can be asked for now. */
function showLine() {
  const ended = ["ended", "failed"].includes(run.phase), open = line === "open";
  const pill = element("line"), banner = element("banner");
  pill.textContent = ended ? PHASES[run.phase] : open ? PHASES[run.phase] ?? LINES.open : LINES[line];
  pill.className = `pill ${run.failure ? "lost" : ended ? "" : line}`;
  const saved = run.output ? `Its map is in ${run.output}.` : "Nothing of it is kept.";
  const told = run.failure ? `The run ended: ${run.failure}. ${saved}`
    : ended ? `The run is over. ${saved}`
    : line === "lost" ? "Connection lost: trying again. What you see is the last that came."
      : line === "refused" ? "The server started anew: open the address that beemap printed." : "";
  banner.textContent = told;
  banner.hidden = !told;
  banner.className = run.phase === "ended" ? "banner" : "banner lost";
  element("save").disabled = element("mark").disabled = !open || run.phase !== "mapping";
  element("save").title = run.output ? "" : "Nothing is kept of this replay";
  element("stop").disabled = !open || run.phase === "finishing";
}

function showAnswer({ text, done }) {
  const answer = element("answer");
  answer.value = text;
  answer.className = done ? "" : "bad";
  clearTimeout(showAnswer.timer);
  showAnswer.timer = setTimeout(() => { answer.value = ""; }, 6000);
}

const order = watch({
  run: showRun,
  strips: (_, blob) => camera.setStrips(blob),
  async picture(values, blob) {
    await camera.show(values, blob);
    picture = { age: values.age, at: performance.now() };
  },
  depth: (values, blob) => depth.show(values, blob),
  async local(values, blob) {
    element("count").textContent = `${values.count} of ${values.full} views`;
    await local.show(values, blob);
  },
  async map(values, blob) {
    map.setMap(values, await inflated(blob));
    element("empty").hidden = values.maps > 0;
    const count = values.maps === 1 ? "1 local map" : `${values.maps} local maps`;
    element("maps").textContent = values.maps ? count : "";
  },
  path: (_, blob) => { map.path = floats(blob); map.redraw(); },
  particles: (_, blob) => { map.particles = floats(blob); map.redraw(); },
  pose(values, blob) {
    map.pose = values.pose;
    map.tail = floats(blob);
    map.redraw();
  },
  answer: showAnswer,
}, (state) => { line = state; showLine(); });

setInterval(() => {
  if (!picture) return;
  const age = picture.age + (performance.now() - picture.at) / 1000;
  const over = ["ended", "failed"].includes(run.phase);
  element("age").textContent = over ? "the last picture" : age > OLD ? `${age.toFixed(0)} s old` : "now";
}, 250);

element("fit").onclick = () => map.look(null);
element("zoom-in").onclick = () => map.zoom(1.5);
element("zoom-out").onclick = () => map.zoom(1 / 1.5);
element("ruler").onclick = (event) => {
  const on = event.currentTarget.getAttribute("aria-pressed") !== "true";
  event.currentTarget.setAttribute("aria-pressed", on);
  map.measure(on);
};
element("save").onclick = () => order("save");
element("mark").onclick = () => { element("place").value = ""; element("naming").showModal(); };
element("naming").onclose = () => {
  const name = element("place").value.trim();
  if (element("naming").returnValue === "mark" && name) order("mark", name);
};
element("stop").onclick = () => element("stopping").showModal();
element("stopping").onclose = () => {
  if (element("stopping").returnValue === "stop") order("stop");
};
// Enter means "Mark", not the first button.
element("place").onkeydown = (event) => {
  if (event.key !== "Enter") return;
  event.preventDefault();
  element("naming").close("mark");
};

const scale = element("colours").getContext("2d");
for (let code = 1; code < 255; code++) {
  scale.fillStyle = `rgb(${distanceColours[code]})`;
  scale.fillRect(code - 1, 0, 1, 1);
}
matchMedia("(prefers-color-scheme: dark)").onchange = () => { map.recolour(); local.recolour(); };
