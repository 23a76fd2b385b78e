// Codes of one byte become colours; `pipeline/web/run_pictures.py` tells what they mean.

const UNKNOWN = 0, FREE = 255, FREE_CELL = 0, OCCUPIED_CELL = 100;

// Near to far: red, yellow, blue; told apart by those who cannot tell red from green.
const DISTANCE = [[0, 165, 0, 38], [0.2, 215, 48, 39], [0.4, 253, 174, 97], [0.55, 255, 240, 150],
  [0.75, 116, 173, 209], [1, 69, 100, 190]];

/** Values of a table between its rows [place, value, ...] at x. */
function between(table, x) {
  const upper = Math.max(1, table.findIndex((row) => row[0] >= x));
  const [a, b] = [table[upper - 1], table[upper]];
  const share = (x - a[0]) / (b[0] - a[0]);
  return a.slice(1).map((value, i) => value + share * (b[i + 1] - value));
}

/** Colour of every code of distance, [r, g, b] each. */
export const distanceColours = Array.from({ length: 256 }, (_, code) =>
  between(DISTANCE, Math.min(1, Math.max(0, (code - 1) / 253))));

export const isDistance = (code) => code !== UNKNOWN && code !== FREE;
export const isFree = (code) => code === FREE;

/** The value of a colour in the style sheet, [r, g, b]. */
export function themed(name) {
  const probe = document.createElement("canvas").getContext("2d");
  probe.fillStyle = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const value = parseInt(probe.fillStyle.slice(1), 16);
  return [value >> 16, (value >> 8) & 255, value & 255];
}

/** Colours of the codes of a map's cells in the present theme. */
export function cellColours() {
  const [wall, free, unknown] = ["--wall", "--free", "--unknown"].map(themed);
  const colours = Array(256).fill(unknown);
  [colours[FREE_CELL], colours[OCCUPIED_CELL]] = [free, wall];
  return colours;
}

/** A canvas of width x height whose pixels are the colours of the codes; `dark` for code 0. */
export function painted(codes, width, height, colours, dark = null) {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext("2d"), image = context.createImageData(width, height);
  for (let i = 0; i < codes.length; i++) {
    const [r, g, b] = dark && codes[i] === 0 ? dark : colours[codes[i]];
    image.data.set([r, g, b, 255], 4 * i);
  }
  context.putImageData(image, 0, 0);
  return canvas;
}

/** What was packed with zlib. */
export async function inflated(blob) {
  const stream = new Blob([blob]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** float32 values; a copy, since they may stand anywhere in the message. */
export const floats = (blob) => new Float32Array(blob.slice().buffer);
