// Pairs as they are drawn in both views. All measures are CSS pixels; the context is scaled to them.

const BLUE = "#3d8bff", RED = "#ff4d42", YELLOW = "#ffd23f";

function outlined(context, draw) {
  for (const [colour, width] of [["#000b", 4], [null, 2]]) {
    context.save();
    context.lineWidth = width;
    if (colour) context.strokeStyle = colour;
    context.beginPath();
    draw();
    context.stroke();
    context.restore();
  }
}

function cross(context, [x, y], size) {
  const gap = 2.5;
  for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
    context.moveTo(x + dx * gap, y + dy * gap);
    context.lineTo(x + dx * size, y + dy * size);
  }
}

/** A pair's end: a cross that leaves its point free, in a ring, with its number. */
export function end(context, at, label, { selected, suspicious, hidden }) {
  context.save();
  context.globalAlpha = hidden ? 0.3 : 1;
  context.strokeStyle = suspicious ? RED : selected ? YELLOW : BLUE;
  outlined(context, () => {
    cross(context, at, 8);
    context.moveTo(at[0] + 11, at[1]);
    context.arc(at[0], at[1], 11, 0, 2 * Math.PI);
  });
  text(context, [at[0] + 13, at[1] - 9], label, context.strokeStyle);
  context.restore();
}

/** Where the camera puts a pair's point, and how far that is from the click. */
export function predicted(context, at, from, suspicious) {
  context.save();
  context.strokeStyle = suspicious ? RED : "#5be0a5";
  outlined(context, () => {
    context.moveTo(...from);
    context.lineTo(...at);
    context.moveTo(at[0] + 3, at[1]);
    context.arc(at[0], at[1], 3, 0, 2 * Math.PI);
  });
  context.restore();
}

/** Half a pair that waits for its other end. */
export function pending(context, at) {
  context.save();
  context.strokeStyle = YELLOW;
  outlined(context, () => cross(context, at, 14));
  text(context, [at[0] + 13, at[1] - 9], "?", YELLOW);
  context.restore();
}

/** Where the other end is expected. */
export function ghost(context, at) {
  context.save();
  context.strokeStyle = YELLOW;
  context.setLineDash([5, 4]);
  outlined(context, () => context.arc(at[0], at[1], 18, 0, 2 * Math.PI));
  context.restore();
}

function text(context, [x, y], words, colour) {
  context.font = "600 12px system-ui, sans-serif";
  context.lineWidth = 3;
  context.lineJoin = "round";
  context.strokeStyle = "#000c";
  context.strokeText(words, x, y);
  context.fillStyle = colour;
  context.fillText(words, x, y);
}
