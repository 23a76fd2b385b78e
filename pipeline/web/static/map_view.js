// The map from above: cells, path, particles, robot, places; moved, enlarged, measured on.

import { cellColours, painted } from "./codes.js";

const ROBOT = 0.16, FIRST_LOOK = 2; // m
const BARS = [50, 20, 10, 5, 2, 1, 0.5, 0.2, 0.1]; // m

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** Pose b seen from where pose a stands. */
export function compose([x, y, theta], [u, v, turn]) {
  const [c, s] = [Math.cos(theta), Math.sin(theta)];
  return [x + c * u - s * v, y + s * u + c * v, theta + turn];
}

function inverse([x, y, theta]) {
  const [c, s] = [Math.cos(theta), Math.sin(theta)];
  return [-c * x - s * y, s * x - c * y, -theta];
}

/** A canvas as large as it is shown, in true pixels; its context in CSS pixels. */
export function fitted(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
  if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return [context, width, height];
}

/** A bar of so many metres in the lower left corner. */
export function scaleBar(context, height, pixelsPerMetre) {
  const metres = BARS.find((m) => m * pixelsPerMetre <= 110) ?? 0.1;
  const length = metres * pixelsPerMetre, y = height - 14;
  context.strokeStyle = context.fillStyle = css("--ink");
  context.lineWidth = 2;
  context.beginPath();
  context.moveTo(12, y - 5); context.lineTo(12, y); context.lineTo(12 + length, y);
  context.lineTo(12 + length, y - 5);
  context.stroke();
  context.font = "13px system-ui, sans-serif";
  context.fillText(`${metres} m`, 16, y - 5);
}

/** The robot, in metres about its origin, looking along x. */
export function drawRobot(context, size = ROBOT) {
  context.fillStyle = css("--robot");
  context.beginPath();
  context.moveTo(size, 0);
  context.lineTo(-0.7 * size, 0.65 * size);
  context.lineTo(-0.35 * size, 0);
  context.lineTo(-0.7 * size, -0.65 * size);
  context.fill();
}

export class MapView {
  constructor(canvas, onMeasured) {
    this.canvas = canvas;
    this.onMeasured = onMeasured;
    this.map = null; this.path = []; this.tail = []; this.particles = []; this.places = [];
    this.pose = null; this.points = []; this.measuring = false;
    this.view = null; // {x, y: metres in the middle, scale: pixels a metre}; null: all of it
    this.pointers = new Map();
    this.drawn = false;
    new ResizeObserver(() => this.redraw()).observe(canvas);
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const name of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(name, (event) => this.pointers.delete(event.pointerId));
    }
    canvas.addEventListener("click", (event) => this.tap(event));
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY / 400), event.offsetX, event.offsetY);
    }, { passive: false });
  }

  /** Draw anew, soon. */
  redraw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.draw(); });
  }

  setMap(values, codes) {
    this.map = { ...values, codes };
    this.places = values.places;
    this.recolour();
  }

  /** In the colours of the present theme. */
  recolour() {
    const map = this.map;
    if (map) map.image = painted(map.codes, map.width, map.height, cellColours());
    this.redraw();
  }

  /** Zoom about a point in pixels; the middle unless given. */
  zoom(factor, u = this.canvas.clientWidth / 2, v = this.canvas.clientHeight / 2) {
    const before = this.metres(u, v), view = { ...this.shown };
    view.scale = Math.min(2000, Math.max(2, view.scale * factor));
    this.look(view);
    const after = this.metres(u, v);
    this.look({ ...view, x: view.x + before[0] - after[0], y: view.y + before[1] - after[1] });
  }

  /** Show so much of it; null: all. */
  look(view) {
    this.view = view;
    this.canvas.classList.toggle("zoomed", view !== null);
    this.redraw();
  }

  /** With the ruler in hand the map stands still, though it may grow. */
  measure(on) {
    this.measuring = on;
    if (on && !this.view) [this.held, this.view] = [true, { ...this.shown }];
    if (!on && this.held) [this.held, this.view] = [false, null];
    this.points = [];
    this.canvas.classList.toggle("measuring", on);
    this.onMeasured(on ? "tap the first point" : "");
    this.redraw();
  }

  tap(event) {
    if (!this.measuring || this.moved) return;
    if (this.points.length === 2) this.points = [];
    this.points.push(this.metres(event.offsetX, event.offsetY));
    const [a, b] = this.points;
    this.onMeasured(b ? `${Math.hypot(a[0] - b[0], a[1] - b[1]).toFixed(2)} m` : "tap the second point");
    this.redraw();
  }

  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    this.moved = false;
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.offsetX, event.offsetY];
    const [du, dv] = [now[0] - before[0], now[1] - before[1]];
    if (!this.moved && this.pointers.size === 1 && Math.hypot(du, dv) < 5) return;
    this.moved = true;
    const others = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
    this.pointers.set(event.pointerId, now);
    if (others.length) {
      const [u, v] = others[0];
      const size = ([a, b]) => Math.hypot(a - u, b - v);
      this.zoom(size(now) / Math.max(1, size(before)), u, v);
    } else {
      const { x, y, scale } = this.shown;
      this.look({ x: x - du / scale, y: y + dv / scale, scale });
    }
  }

  /** What is shown now. */
  get shown() {
    if (this.view) return this.view;
    let [left, low, right, high] = [Infinity, Infinity, -Infinity, -Infinity];
    const take = (x, y) => {
      [left, low] = [Math.min(left, x), Math.min(low, y)];
      [right, high] = [Math.max(right, x), Math.max(high, y)];
    };
    if (this.map) {
      const { origin: [x, y], cell, width, height } = this.map;
      take(x, y); take(x + width * cell, y + height * cell);
    } else {
      const [x, y] = this.pose ?? [0, 0];
      take(x - FIRST_LOOK, y - FIRST_LOOK); take(x + FIRST_LOOK, y + FIRST_LOOK);
    }
    for (let i = 0; i + 1 < this.tail.length; i += 2) take(this.tail[i], this.tail[i + 1]);
    const [w, h] = [this.canvas.clientWidth - 24, this.canvas.clientHeight - 40];
    const scale = Math.max(1, Math.min(w / (right - left), h / (high - low)));
    return { x: (left + right) / 2, y: (low + high) / 2, scale };
  }

  metres(u, v) {
    const { x, y, scale } = this.shown;
    return [x + (u - this.canvas.clientWidth / 2) / scale, y - (v - this.canvas.clientHeight / 2) / scale];
  }

  draw() {
    const [context, width, height] = fitted(this.canvas);
    const { x, y, scale } = this.shown;
    context.clearRect(0, 0, width, height);
    context.save();
    context.translate(width / 2, height / 2);
    context.scale(scale, -scale);
    context.translate(-x, -y);
    this.drawCells(context, scale);
    this.drawPath(context, scale);
    this.drawParticles(context, scale);
    if (this.pose) {
      context.save();
      context.translate(this.pose[0], this.pose[1]);
      context.rotate(this.pose[2]);
      drawRobot(context, Math.max(ROBOT, 9 / scale));
      context.restore();
    }
    context.restore();
    const pixels = (p) => [width / 2 + (p[0] - x) * scale, height / 2 - (p[1] - y) * scale];
    this.drawPlaces(context, pixels);
    this.drawRuler(context, pixels);
    scaleBar(context, height, scale);
  }

  drawCells(context, scale) {
    const map = this.map;
    if (!map) return;
    // Cells smaller than a pixel would flicker as the map is moved.
    context.imageSmoothingEnabled = scale * map.cell * window.devicePixelRatio < 1;
    context.drawImage(map.image, map.origin[0], map.origin[1], map.width * map.cell, map.height * map.cell);
  }

  drawPath(context, scale) {
    context.strokeStyle = css("--path");
    context.lineWidth = 2.5 / scale;
    context.lineJoin = "round";
    context.beginPath();
    for (const line of [this.path, this.tail]) {
      for (let i = 0; i + 1 < line.length; i += 2) {
        if (i === 0 && line === this.path) context.moveTo(line[0], line[1]);
        else context.lineTo(line[i], line[i + 1]);
      }
    }
    if (this.pose) context.lineTo(this.pose[0], this.pose[1]);
    context.stroke();
  }

  drawParticles(context, scale) {
    if (!this.pose || this.particles.length < 3) return;
    // The first is the best: all have moved since as it has.
    const moved = compose(inverse(this.particles.slice(0, 3)), this.pose);
    context.fillStyle = css("--particle");
    const size = 2 / scale;
    for (let i = 0; i + 2 < this.particles.length; i += 3) {
      const [px, py] = compose(this.particles.slice(i, i + 3), moved);
      context.fillRect(px - size / 2, py - size / 2, size, size);
    }
  }

  drawPlaces(context, pixels) {
    context.font = "600 13px system-ui, sans-serif";
    context.textBaseline = "middle";
    context.lineJoin = "round";
    for (const place of this.places) {
      const [u, v] = pixels([place.x, place.y]);
      context.fillStyle = css("--place");
      context.beginPath();
      context.moveTo(u, v - 7); context.lineTo(u + 7, v); context.lineTo(u, v + 7);
      context.lineTo(u - 7, v);
      context.fill();
      context.strokeStyle = css("--card");
      context.lineWidth = 4;
      const length = context.measureText(place.name).width + 11;
      const begin = u + length < this.canvas.clientWidth ? u + 11 : u - length;
      context.strokeText(place.name, begin, v);
      context.fillText(place.name, begin, v);
    }
    context.textBaseline = "alphabetic";
  }

  drawRuler(context, pixels) {
    const points = this.points.map(pixels);
    context.strokeStyle = context.fillStyle = css("--measure");
    context.lineWidth = 2.5;
    context.beginPath();
    points.forEach(([u, v], i) => (i ? context.lineTo(u, v) : context.moveTo(u, v)));
    context.stroke();
    for (const [u, v] of points) {
      context.beginPath();
      context.arc(u, v, 5, 0, 2 * Math.PI);
      context.fill();
    }
  }
}
