// Keys. Letters are read by what they write, so that every keyboard has them where it prints them; nothing needs AltGr.

const SMALL = Math.PI / 1800;

/** What a key does to the camera by hand, or null: a shift in pixels, a turn, a factor of the distance. */
function motion(key, large) {
  const k = large ? 10 : 1;
  const shift = { ArrowLeft: [-k, 0], ArrowRight: [k, 0], ArrowUp: [0, -k], ArrowDown: [0, k] }[key];
  const turn = { i: [1, 0, 0], k: [-1, 0, 0], j: [0, -1, 0], l: [0, 1, 0], u: [0, 0, -1], o: [0, 0, 1] }[key.toLowerCase()];
  const nearer = { "+": 1, "*": 1, PageUp: 1, "-": -1, _: -1, PageDown: -1 }[key];
  if (shift) return { shift, turn: [0, 0, 0], distance: 1 };
  if (turn) return { shift: [0, 0], turn: turn.map((x) => x * k * SMALL), distance: 1 };
  if (nearer) return { shift: [0, 0], turn: [0, 0, 0], distance: 1.001 ** (-nearer * k) };
  return null;
}

/** Calls the task of each key. `tasks.nudging()` says whether keys move the camera. */
export function listen(tasks) {
  const plain = {
    r: tasks.register, R: tasks.registerAll, a: tasks.accept, b: tasks.pairsPose, n: () => tasks.step(1), p: () => tasks.step(-1),
    o: tasks.nextMode, c: tasks.look, v: tasks.nextSide, f: tasks.fit, s: tasks.nextShading, m: tasks.nudge, h: tasks.help,
    "?": tasks.help, F1: tasks.help, Delete: tasks.remove, Backspace: tasks.remove, Escape: tasks.escape,
    q: () => tasks.roll(-1), e: () => tasks.roll(1),
  };
  addEventListener("keydown", (event) => {
    if (event.target.matches("input[type=text], select") || document.querySelector("dialog[open]")) return;
    if (event.altKey || event.isComposing) return;
    const command = event.ctrlKey || event.metaKey;
    let task = null;
    if (command) {
      const key = event.key.toLowerCase();
      if (key === "z") task = event.shiftKey ? tasks.redo : tasks.undo;
      if (key === "y") task = tasks.redo;
    } else if (tasks.nudging() && motion(event.key, event.shiftKey)) {
      task = () => tasks.move(motion(event.key, event.shiftKey));
    } else if (!(event.target.matches("button, [role=separator], input") && ["Enter", " "].includes(event.key))) {
      // With caps lock on, a letter without Shift is the same letter.
      const capital = event.key.length === 1 && event.key !== event.key.toLowerCase();
      task = plain[event.shiftKey || !capital ? event.key : event.key.toLowerCase()] ?? (event.shiftKey ? null : plain[event.key.toLowerCase()]);
    }
    if (!task) return;
    event.preventDefault();
    task();
  });
}
