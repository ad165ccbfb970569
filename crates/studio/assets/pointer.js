// Mouse, pen and touchpad on a canvas: clicks, drags and wheels, in CSS pixels from the canvas' corner.

const STILL = 4;

const place = (canvas, event) => {
  const box = canvas.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
};

/** Whether a wheel event comes from two fingers on a touchpad rather than from a mouse's wheel. */
function byFingers(event) {
  if (event.deltaMode !== 0) return false;
  if (event.deltaX !== 0 && !event.shiftKey) return true;
  return event.wheelDeltaY !== undefined && event.wheelDeltaY % 120 !== 0;
}

/**
 * `grab(at, event)` may return a handler `{move(at, by), end()}` for a thing under the pointer; otherwise a drag goes to
 * `drag(by, at, event)`. `click(at)` is a press without motion, `zoom(factor, at)` and `pan(by)` are wheels and fingers,
 * `hover(at | null)` the pointer without a button.
 */
export function watch(canvas, { grab, drag, click, zoom, pan, hover, rest }) {
  let press = null;
  canvas.addEventListener("pointerdown", (event) => {
    canvas.focus({ preventScroll: true });
    canvas.setPointerCapture(event.pointerId);
    const at = place(canvas, event);
    const thing = event.button === 0 ? grab(at, event) : null;
    press = { at, last: at, thing, moved: false, button: event.button, id: event.pointerId };
    event.preventDefault();
  });
  canvas.addEventListener("pointermove", (event) => {
    const at = place(canvas, event);
    if (!press) return hover(at);
    if (press.id !== event.pointerId) return;
    if (!press.moved && Math.hypot(at[0] - press.at[0], at[1] - press.at[1]) < STILL) return;
    press.moved = true;
    canvas.classList.add("grab");
    const by = [at[0] - press.last[0], at[1] - press.last[1]];
    if (press.thing) {
      press.thing.move([at[0] - press.at[0], at[1] - press.at[1]]);
      hover(at);
    } else drag(by, at, { shift: event.shiftKey || press.button !== 0, roll: event.ctrlKey || event.metaKey });
    press.last = at;
  });
  const release = (event) => {
    if (!press || press.id !== event.pointerId) return;
    const { thing, moved, button, at } = press;
    press = null;
    canvas.classList.remove("grab");
    if (event.type === "pointercancel") return;
    if (thing && moved) thing.end();
    else if (thing) thing.click?.();
    else if (!moved && button === 0) click(at);
    else rest?.();
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("pointerleave", () => !press && hover(null));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const unit = event.deltaMode === 1 ? 33 : event.deltaMode === 2 ? 400 : 1;
    // Browsers report a pinch as a wheel with the control key.
    if (!event.ctrlKey && byFingers(event)) return pan([-event.deltaX * unit, -event.deltaY * unit]);
    const speed = event.ctrlKey && byFingers(event) ? 0.01 : 0.0016;
    zoom(Math.exp(-event.deltaY * unit * speed), place(canvas, event));
  }, { passive: false });
}

/** Keeps a canvas as many pixels as the screen has there. */
export function fitted(canvas, changed) {
  const resize = () => {
    const ratio = devicePixelRatio || 1;
    const box = canvas.getBoundingClientRect();
    const [width, height] = [Math.max(1, Math.round(box.width * ratio)), Math.max(1, Math.round(box.height * ratio))];
    if (canvas.width === width && canvas.height === height) return;
    [canvas.width, canvas.height] = [width, height];
    changed();
  };
  new ResizeObserver(resize).observe(canvas);
  matchMedia(`(resolution: ${devicePixelRatio}dppx)`).addEventListener("change", resize);
  resize();
}
