// The magnifier in a pane's corner: what is under the pointer, eight times as large.

export const TIMES = 8;

/** `draw(context, size)` paints the surroundings of the pointer so that it is in the middle. */
export function show(canvas, pane, at, draw) {
  if (!at) {
    canvas.hidden = true;
    return;
  }
  const ratio = devicePixelRatio || 1;
  const size = Math.round(176 * ratio);
  if (canvas.width !== size) canvas.width = canvas.height = size;
  canvas.hidden = false;
  const box = pane.getBoundingClientRect();
  // Out of the pointer's way.
  canvas.classList.toggle("left", at[0] > box.width - 230 && at[1] > box.height - 230);
  const context = canvas.getContext("2d");
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.fillStyle = "#000";
  context.fillRect(0, 0, size, size);
  draw(context, size);
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  for (const [colour, width] of [["#000b", 3], ["#ffd23f", 1]]) {
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.beginPath();
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      context.moveTo(88 + dx * 6, 88 + dy * 6);
      context.lineTo(88 + dx * 26, 88 + dy * 26);
    }
    context.stroke();
  }
}
