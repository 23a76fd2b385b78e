// What to do now, in words that are read from two metres away.

const PLACES = { middle: "in the middle", left: "on the left", right: "on the right", top: "at the top",
  bottom: "at the bottom", "upper left": "in the upper left", "upper right": "in the upper right",
  "lower left": "in the lower left", "lower right": "in the lower right" };

/** Left and right exchanged: in a mirror. */
export const exchanged = (words) =>
  words.replace(/left|right/g, (side) => (side === "left" ? "right" : "left"));

/** Where and how to hold the board. */
export function asked(ghost, wishes, mirrored) {
  if (!wishes.length) return "Enough: put the board down";
  if (!ghost) return "Hold it at any other place, tilted in another way";
  if (!ghost.place) return "Show the whole board to both cameras";
  const seen = (words) => (mirrored ? exchanged(words) : words);
  const parts = [`Hold it ${PLACES[seen(ghost.place)]}`];
  if (ghost.words) parts.push(ghost.words === "nearer" ? "nearer to the cameras" : ghost.words);
  if (ghost.edge) parts.push(`its ${seen(ghost.edge)} edge nearer`);
  return parts.join(", ");
}

/** What became of the latest pair, [words, how they look]; fits: the board is held as asked. */
export function became(why, fits) {
  if (why === "kept") return ["Taken", "kept"];
  if (why === "hold it still") {
    return fits ? ["That is the place: hold it still", "hold"] : ["Move it to the outline and hold it still", ""];
  }
  if (why === "seen already") return ["Move it to the outline", ""];
  if (why.startsWith("blurred")) return ["Blurred: hold it still, in good light", "hold"];
  if (why === "no board in the left and the right image") return ["Neither camera sees the board", "gone"];
  const side = why.match(/^no board in the (left|right) image$/);
  return side ? [`The ${side[1]} camera does not see the board`, "gone"] : [why, ""];
}
