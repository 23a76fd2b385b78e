// One camera's image with the corners found in it; over the left one, the board as it should be held.

import { fitted } from "./map_view.js";

const FITS = 0.05; // of the image's width that the board's corners may be off
const SIDE = { upper: [0, 1], right: [1, 2], lower: [2, 3], left: [3, 0] }; // of an outline
const GHOST = "#ffc83d", FITTING = "#2fe39b", DARK = "rgb(0 0 0 / .65)", CORNER = "#2fe39b";

const middle = (points) => [0, 1].map((axis) => points.reduce((sum, p) => sum + p[axis], 0) / points.length);

export class BoardView {
  /** mirrored: () => whether images are shown as a mirror does. */
  constructor(canvas, mirrored) {
    [this.canvas, this.mirrored] = [canvas, mirrored];
    this.bitmap = null; this.corners = []; this.outline = null; this.ghost = null;
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  /** bitmap: the image; half: 0 or 1, of one that shows both side by side; corners: u, v, u, v, ... */
  show(bitmap, half, corners, outline) {
    if (this.bitmap !== bitmap) this.bitmap?.close();
    Object.assign(this, { bitmap, half, corners, outline });
    const ratio = this.sourceWidth() / bitmap.height;
    this.canvas.style.aspectRatio = ratio;
    this.canvas.style.setProperty("--ratio", ratio);
    this.draw();
  }

  sourceWidth() { return this.half === null ? this.bitmap.width : this.bitmap.width / 2; }

  /** Whether the board is held as the ghost is. */
  get fits() {
    if (!this.ghost || !this.outline) return false;
    const ratio = this.canvas.clientHeight / this.canvas.clientWidth;
    const apart = ([u, v], [x, y]) => Math.hypot(u - x, (v - y) * ratio);
    const off = this.ghost.outline.map((corner) =>
      Math.min(...this.outline.map((seen) => apart(corner, seen))));
    return off.reduce((sum, one) => sum + one, 0) / 4 < FITS;
  }

  draw() {
    if (!this.bitmap) return;
    const [context, width, height] = fitted(this.canvas), flip = this.mirrored();
    const at = ([u, v]) => [(flip ? 1 - u : u) * width, v * height];
    context.save();
    if (flip) context.transform(-1, 0, 0, 1, width, 0);
    const wide = this.sourceWidth();
    context.drawImage(this.bitmap, wide * (this.half ?? 0), 0, wide, this.bitmap.height, 0, 0, width, height);
    context.restore();
    this.drawCorners(context, at, Math.max(2, width / 200));
    if (this.ghost) this.drawGhost(context, at, width);
  }

  drawCorners(context, at, radius) {
    for (let i = 0; i < this.corners.length; i += 2) {
      const [x, y] = at([this.corners[i], this.corners[i + 1]]);
      for (const [size, colour] of [[radius * 1.5, DARK], [radius, CORNER]]) {
        context.fillStyle = colour;
        context.beginPath();
        context.arc(x, y, size, 0, 2 * Math.PI);
        context.fill();
      }
    }
  }

  drawGhost(context, at, width) {
    const { outline, lines, edge } = this.ghost, colour = this.fits ? FITTING : GHOST;
    const thick = Math.max(3, width / 160);
    const stroke = (points, closed, size, style) => {
      context.lineWidth = size;
      context.strokeStyle = style;
      context.beginPath();
      for (const point of points) context.lineTo(...at(point));
      if (closed) context.closePath();
      context.stroke();
    };
    context.lineJoin = context.lineCap = "round";
    context.globalAlpha = 0.45;
    for (const line of lines) stroke(line, false, 1.2, colour);
    context.globalAlpha = 1;
    stroke(outline, true, thick + 3, DARK);
    stroke(outline, true, thick, colour);
    if (!edge) return;
    const nearer = SIDE[edge].map((i) => outline[i]);
    stroke(nearer, false, 3 * thick + 3, DARK);
    stroke(nearer, false, 3 * thick, colour);
    this.label(context, "nearer", at(middle(nearer)), at(middle(outline)), width, colour);
  }

  /** A word just inside of an edge. */
  label(context, text, [x, y], [inX, inY], width, colour) {
    const size = Math.max(14, width / 30), away = Math.hypot(inX - x, inY - y) || 1;
    context.font = `700 ${size}px system-ui, sans-serif`;
    const half = context.measureText(text).width / 2;
    const gap = size * 0.9 + (Math.abs(inX - x) / away) * half;
    context.textAlign = "center";
    context.textBaseline = "middle";
    const place = [x + ((inX - x) / away) * gap, y + ((inY - y) / away) * gap];
    context.lineWidth = size / 4;
    context.strokeStyle = DARK;
    context.strokeText(text, ...place);
    context.fillStyle = colour;
    context.fillText(text, ...place);
  }
}
