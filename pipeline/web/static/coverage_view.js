// Where boards were in one camera's images: a small map of the image.

import { themed } from "./codes.js";
import { fitted } from "./map_view.js";

const css = (name) => `rgb(${themed(name)})`;

export class CoverageView {
  constructor(canvas, mirrored) {
    [this.canvas, this.mirrored] = [canvas, mirrored];
    this.mask = null; this.outline = null;
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  /** mask: 1 where a board was, width x height; outline: of the board to come, or null. */
  show(mask, width, height, ratio, outline) {
    Object.assign(this, { mask, width, height, outline });
    this.canvas.style.aspectRatio = ratio;
    this.draw();
  }

  draw() {
    if (!this.mask) return;
    const [context, width, height] = fitted(this.canvas), flip = this.mirrored();
    context.clearRect(0, 0, width, height);
    context.save();
    if (flip) context.transform(-1, 0, 0, 1, width, 0);
    context.drawImage(this.painted(), 0, 0, width, height);
    context.strokeStyle = css("--card");
    context.lineWidth = 1;
    for (const third of [1 / 3, 2 / 3]) {
      context.strokeRect(third * width, -1, 0, height + 2);
      context.strokeRect(-1, third * height, width + 2, 0);
    }
    if (this.outline) {
      context.strokeStyle = css("--accent");
      context.lineWidth = 2.5;
      context.beginPath();
      for (const [u, v] of this.outline) context.lineTo(u * width, v * height);
      context.closePath();
      context.stroke();
    }
    context.restore();
  }

  /** The mask in the colours of the present theme. */
  painted() {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [this.width, this.height];
    const context = canvas.getContext("2d"), image = context.createImageData(this.width, this.height);
    const colour = themed("--covered");
    this.mask.forEach((covered, i) => image.data.set([...colour, covered ? 255 : 0], 4 * i));
    context.putImageData(image, 0, 0);
    return canvas;
  }
}
