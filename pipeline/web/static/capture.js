// The page of a calibration capture: where to hold the board, what was taken, the verdict.

import { BoardView } from "./board_view.js";
import { asked, became, exchanged } from "./capture_words.js";
import { floats, inflated } from "./codes.js";
import { watch } from "./connection.js";
import { CoverageView } from "./coverage_view.js";

const TOLD_MS = 1200; // that "Taken" stays
const LONG_MS = 20000; // at one outline
const FEWEST = 3; // views that can be calibrated with
const PHASES = { connecting: "waiting for the cameras", taking: "live", solving: "calibrating",
  solved: "done", ended: "ended" };
const LINES = { lost: "connection lost", refused: "not let in" };

const element = (id) => document.getElementById(id);
const isMirrored = () => element("mirror").getAttribute("aria-pressed") === "true";
const left = new BoardView(element("left"), isMirrored), right = new BoardView(element("right"), isMirrored);
const maps = ["left-map", "right-map"].map((id) => new CoverageView(element(id), isMirrored));
let line = "lost", capture = { phase: "connecting" }, views = { kept: 0, wishes: ["?"], ghost: null };
let verdict = null, shownKept = null, toldUntil = 0, askedAt = performance.now();

function made(name, text) {
  const node = document.createElement(name);
  node.textContent = text;
  return node;
}

/** The parts of a blob, by their lengths. */
function cut(blob, sizes) {
  let at = 0;
  return sizes.map((size) => blob.subarray(at, (at += size)));
}

const bitmap = (jpeg) => createImageBitmap(new Blob([jpeg], { type: "image/jpeg" })).catch(() => null);

async function showPair(values, blob) {
  const [inLeft, inRight, ...jpegs] = cut(blob, values.sizes);
  const images = await Promise.all(jpegs.map(bitmap));
  if (images.includes(null)) return; // damaged on their way
  const beside = images.length === 1;
  const second = beside ? await bitmap(jpegs[0]) : images[1];
  left.show(images[0], beside ? 0 : null, floats(inLeft), values.outline);
  right.show(second, beside ? 1 : null, floats(inRight), null);
  showGood("still", values.moved);
  showGood("sharp", values.blur);
  element("hint").hidden = capture.phase !== "taking" || performance.now() < askedAt + LONG_MS;
  if (capture.phase !== "taking" || performance.now() < toldUntil) return;
  say(...became(values.why, left.fits));
}

/** A bar that is full where a value is within its limit; over: the value over the limit. */
function showGood(id, over) {
  const share = over === null ? 0 : Math.min(1, 1 / Math.max(over, 0.01));
  element(id).style.setProperty("--share", `${100 * share}%`);
  element(id).ariaValueNow = share;
  element(id).className = `level ${share === 1 ? "good" : ""}`;
}

function say(words, kind) {
  element("now").textContent = words;
  element("now").className = `now ${kind}`;
}

async function showViews(values, blob) {
  views = values;
  askedAt = performance.now();
  left.ghost = views.ghost;
  const both = await inflated(blob), size = views.width * views.height;
  maps.forEach((map, i) => map.show(both.subarray(i * size, (i + 1) * size), views.width, views.height,
    views.size[0] / views.size[1], i ? null : views.ghost?.outline));
  ["left-share", "right-share"].forEach((id, i) => {
    element(id).textContent = `${Math.round(100 * views.shares[i])} %`;
    element(id).className = views.shares[i] >= views.enough_share ? "done" : "";
  });
  if (shownKept !== null && views.kept > shownKept) flash();
  shownKept = views.kept;
  element("count").textContent = views.kept;
  element("enough").textContent = views.kept < views.enough ? `of ${views.enough} views` : "views";
  element("distances").className = views.distances ? "done" : "";
  showAsked();
}

/** One was taken. */
function flash() {
  const light = element("flash");
  light.hidden = true;
  void light.offsetWidth; // begins anew
  light.hidden = false;
  say(...became("kept"));
  toldUntil = performance.now() + TOLD_MS;
}

/** Where to hold it, and which edges were nearer, as they are seen on the page. */
function showAsked() {
  const phase = capture.phase, mirrored = isMirrored();
  for (const item of element("tilts").querySelectorAll("[data-edge]")) {
    const edge = mirrored ? exchanged(item.dataset.edge) : item.dataset.edge;
    item.className = views.lacking && !views.lacking.includes(edge) ? "done" : "";
  }
  if (phase === "connecting") element("target").textContent = "Waiting for the cameras";
  if (phase === "taking") element("target").textContent = asked(views.ghost, views.wishes, mirrored);
  if (phase === "solving" || phase === "ended") left.ghost = null;
  for (const view of [left, right, ...maps]) view.draw();
}

function showCapture(values) {
  if (capture.id && capture.id !== values.id) return location.reload(); // another one
  capture = values;
  element("name").textContent = `${capture.name}, ${capture.board}`;
  element("folder").textContent = capture.folder;
  const [done, total] = capture.looked_at;
  if (capture.phase === "solving") {
    element("target").textContent = "Enough: put the board down";
    say(done < total ? `Looking at image ${done} of ${total}` : "Calibrating ...", "hold");
  }
  if (capture.phase === "ended" && !verdict) {
    element("target").textContent = "No calibration";
    say(capture.said || "beemap has ended", "");
  }
  showAsked();
  showLine();
}

function showVerdict(values) {
  verdict = values;
  element("verdict").textContent = verdict.verdict;
  element("verdict").className = `verdict ${verdict.verdict}`;
  element("meaning").textContent = 
    `Views left out of the calibration come to lie on one row within ${verdict.rows}: ${verdict.meaning}.`;
  const [next, ...also] = verdict.steps;
  element("next").textContent = next;
  element("also").replaceChildren(...also.map((step) => made("li", step)));
  element("facts").replaceChildren(...verdict.facts.flatMap(([name, value]) => [made("dt", name), made("dd", value)]));
  element("written").textContent = `Written: ${verdict.rig_file} and ${verdict.report}`;
  element("taking").hidden = element("mirror").hidden = true;
  element("solved").hidden = false;
  scrollTo(0, 0);
}

async function showThumbnails(values, blob) {
  const list = element("thumbnails"), known = list.childElementCount;
  for (const jpeg of cut(blob, values.sizes).slice(known)) {
    const item = document.createElement("li"), canvas = document.createElement("canvas");
    const image = await bitmap(jpeg);
    [canvas.width, canvas.height] = [image?.width ?? 4, image?.height ?? 3];
    if (image) canvas.getContext("2d").drawImage(image, 0, 0);
    image?.close();
    item.append(canvas);
    list.append(item);
  }
  element("kept-card").hidden = false;
  list.scrollLeft = list.scrollWidth;
}

/** How the line is, and what can be asked for. */
function showLine() {
  const open = line === "open", ended = capture.phase === "ended";
  const pill = element("line"), banner = element("banner");
  pill.textContent = ended || open ? PHASES[capture.phase] : LINES[line];
  pill.className = `pill ${ended ? "" : line}`;
  const told = ended ? (verdict ? "beemap has ended; this is its verdict." : "")
    : line === "lost" ? "Connection lost: trying again. What you see is the last that came."
      : line === "refused" ? "The server started anew: open the address that beemap printed." : "";
  banner.textContent = told;
  banner.hidden = !told;
  banner.className = ended ? "banner" : "banner lost";
  const stop = element("stop"), solved = capture.phase === "solved";
  stop.textContent = solved || (ended && verdict) ? "Done" : "Enough";
  stop.disabled = !open || !(solved || capture.phase === "taking");
  element("report").hidden = !open;
}

function showAnswer({ text, done }) {
  element("answer").value = text;
  element("answer").className = done ? "" : "bad";
}

const order = watch({ capture: showCapture, pair: showPair, views: showViews, thumbnails: showThumbnails,
  verdict: (values) => { showVerdict(values); showLine(); }, answer: showAnswer,
}, (state) => { line = state; showLine(); });

element("stop").onclick = () => {
  if (capture.phase === "solved") return order("close");
  const few = views.kept < FEWEST;
  const wishes = views.wishes.slice(0, 3).map((wish) => (isMirrored() ? exchanged(wish) : wish)).join("; ");
  element("question").textContent = few
    ? `Stop without a calibration? There are ${views.kept} views, and ${FEWEST} are the least.`
    : `Calibrate with the ${views.kept} views so far? Still missing: ${wishes}.`;
  element("confirm").textContent = few ? "Stop" : "Calibrate";
  element("stopping").showModal();
};
element("stopping").onclose = () => {
  if (element("stopping").returnValue === "enough") order("enough");
};
element("mirror").onclick = () => {
  element("mirror").setAttribute("aria-pressed", !isMirrored());
  document.body.classList.toggle("mirrored", isMirrored());
  showAsked();
};
document.body.classList.add("mirrored");
matchMedia("(prefers-color-scheme: dark)").onchange = () => { for (const map of maps) map.draw(); };
