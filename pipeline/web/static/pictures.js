// The small pictures: the left image with its columns, stereo depth, the local map.

import { cellColours, distanceColours, floats, inflated, isDistance, isFree, painted } from "./codes.js";
import { drawRobot, fitted, scaleBar } from "./map_view.js";

const DARK = [34, 34, 40];
const AROUND = 0.3; // m beside what is known of the local map

/** The left image, tinted where the columns look. */
export class CameraView {
  constructor(canvas) {
    this.canvas = canvas;
    this.edges = [];
  }

  setStrips(blob) { this.edges = floats(blob); }

  async show(values, blob) {
    const jpeg = new Blob([blob.subarray(values.columns)], { type: "image/jpeg" });
    const image = await createImageBitmap(jpeg).catch(() => null); // damaged on its way
    if (!image) return;
    const width = values.both ? image.width / 2 : image.width;
    const canvas = this.canvas;
    if (canvas.width !== width || canvas.height !== image.height) {
      [canvas.width, canvas.height] = [width, image.height];
      canvas.style.aspectRatio = `${width} / ${image.height}`;
    }
    const context = canvas.getContext("2d");
    context.drawImage(image, 0, 0, width, image.height, 0, 0, width, image.height);
    image.close();
    this.tint(context, blob.subarray(0, values.columns));
  }

  tint(context, codes) {
    const { width, height } = this.canvas;
    // Whole pixels: neighbours would show a seam between them.
    const corner = (i, end) =>
      [Math.round(this.edges[4 * i + end] * width), this.edges[4 * i + end + 1] * height];
    if (this.edges.length !== 4 * (codes.length + 1)) return;
    codes.forEach((code, i) => {
      const [a, b, c, d] = [corner(i, 0), corner(i + 1, 0), corner(i + 1, 2), corner(i, 2)];
      const foot = ([u, v], [, w]) => [u, v + 0.93 * (w - v)];
      if (isFree(code)) return;
      const [r, g, blue] = distanceColours[code];
      const fill = (colour, corners) => {
        context.fillStyle = colour;
        context.beginPath();
        for (const [u, v] of corners) context.lineTo(u, v);
        context.fill();
      };
      if (!isDistance(code)) return fill("rgb(0 0 0 / .55)", [a, b, c, d]);
      fill(`rgb(${r} ${g} ${blue} / .35)`, [a, b, c, d]);
      fill(`rgb(${r} ${g} ${blue})`, [foot(a, d), foot(b, c), c, d]);
    });
  }
}

/** The disparity image as distances. */
export class DepthView {
  constructor(canvas) { this.canvas = canvas; }

  async show({ width, height, shape }, blob) {
    const image = painted(await inflated(blob), width, height, distanceColours, DARK);
    [this.canvas.width, this.canvas.height] = [width, height];
    this.canvas.style.aspectRatio = shape;
    this.canvas.getContext("2d").drawImage(image, 0, 0);
  }
}

/** The local map about the robot, which looks up. */
export class LocalView {
  constructor(canvas) {
    this.canvas = canvas;
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  async show(values, blob) {
    this.map = { ...values, codes: await inflated(blob) };
    this.recolour();
  }

  /** In the colours of the present theme. */
  recolour() {
    const map = this.map;
    if (!map) return;
    map.image = painted(map.codes, map.width, map.height, cellColours());
    this.draw();
  }

  draw() {
    const map = this.map;
    if (!map) return;
    const [context, width, height] = fitted(this.canvas);
    const [ahead, aside] = [map.width * map.cell, map.height * map.cell];
    const scale = Math.min(height / (ahead + 2 * AROUND), width / (aside + 2 * AROUND));
    context.clearRect(0, 0, width, height);
    context.save();
    context.translate(width / 2, height / 2);
    context.scale(scale, -scale);
    context.rotate(Math.PI / 2);
    context.translate(-map.origin[0] - ahead / 2, -map.origin[1] - aside / 2);
    context.imageSmoothingEnabled = false;
    context.drawImage(map.image, map.origin[0], map.origin[1], ahead, aside);
    drawRobot(context);
    context.restore();
    scaleBar(context, height, scale);
  }
}
