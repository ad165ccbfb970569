// The page: it holds what this tab looks at; what is known of the project comes from the server, and goes there.

import * as server from "./server.js";
import * as keys from "./keys.js";
import * as lists from "./lists.js";
import { ModelView } from "./model.js";
import { PhotoView } from "./photo.js";
import { SHEET, next } from "./words.js";

const $ = (id) => document.getElementById(id);
const MODES = ["outline", "blend", "flicker", "checker", "off"];

let state = null;
/** What this tab looks at. */
const tab = { photo: 0, selected: null, mode: "off", shading: "shaded", nudging: false, ghost: {}, opened: null, stages: {}, notice: 0 };

// ---- words that pass

function toast(words) {
  const line = lists.element("p", {}, words);
  $("toasts").append(line);
  setTimeout(() => line.remove(), 3000 + 60 * words.length);
}

const fail = (error) => toast(error.message ?? String(error));
const trying = (task) => async (...all) => {
  try {
    return await task(...all);
  } catch (error) {
    fail(error);
  }
};

// ---- what people do

const current = () => state?.photos[tab.photo];
const act = trying((action, photo = tab.photo) => server.tell(`/api/photo/${photo}/act`, action));

/** Sends moves one after another: of those that come meanwhile, the last. */
const mover = () => {
  let busy = false;
  let waiting = null;
  const send = async (message) => {
    if (busy) {
      waiting = message;
      return;
    }
    busy = true;
    await act(message);
    busy = false;
    if (waiting) {
      const last = waiting;
      waiting = null;
      send(last);
    }
  };
  return send;
};
const movePhotoEnd = mover();
const moveModelEnd = mover();

/** Nudges add up while one is on its way. */
const nudge = (() => {
  let sum = null;
  let busy = false;
  let gesture = 0;
  let timer;
  return async (motion) => {
    clearTimeout(timer);
    if (!gesture) gesture = Math.floor(Math.random() * 2 ** 50);
    timer = setTimeout(() => (gesture = 0), 800);
    const add = (a, b) => a.map((x, i) => x + b[i]);
    sum = sum ? { shift: add(sum.shift, motion.shift), turn: add(sum.turn, motion.turn), distance: sum.distance * motion.distance } : motion;
    if (busy) return;
    busy = true;
    while (sum) {
      const all = sum;
      sum = null;
      await act({ do: "nudge", ...all, gesture });
    }
    busy = false;
  };
})();

function select(id) {
  tab.selected = id;
  const pair = current()?.pairs.find((pair) => pair.id === id);
  if (pair) {
    photoView.reveal(pair.uv);
    modelView.reveal(pair.xyz);
  }
  show();
}

/** After a click into the photo: where the model is expected to show it. */
const expectOnModel = trying(async (uv) => {
  const { xyz } = await server.ask(`/api/photo/${tab.photo}/ray`, { x: uv[0], y: uv[1] });
  tab.ghost.model = xyz;
  if (xyz) modelView.reveal(xyz);
  show();
});

const clickPhoto = async (uv) => {
  const half = current().pending;
  tab.ghost = {};
  await act({ do: "photo", uv });
  if (!half?.xyz && current().camera) expectOnModel(uv);
};

/** After a click onto the model: where the photo is expected to show it. */
const expectInPhoto = trying(async ([x, y, z]) => {
  const { uv } = await server.ask(`/api/photo/${tab.photo}/pixel`, { x, y, z });
  if (!uv || !photoView.inside(uv)) return;
  tab.ghost.photo = uv;
  photoView.reveal(uv);
  show();
});

const clickModel = async (xyz) => {
  const half = current().pending;
  tab.ghost = {};
  await act({ do: "model", xyz });
  if (!half?.uv && current().camera) expectInPhoto(xyz);
};

const open = trying(async (number) => {
  if (!state?.photos[number]) return;
  Object.assign(tab, { photo: number, selected: null, ghost: {}, nudging: false, opened: null });
  sessionStorage.setItem("photo", number);
  show();
  await photoView.open(number);
  if (tab.photo !== number) return;
  tab.opened = number;
  show();
  if (current().camera) look();
});

const look = () => {
  const photo = current();
  if (!photo?.camera || !photo.size) return toast("The photo has no camera yet: pick four pairs.");
  modelView.look(photo.camera, photo.size);
};

const register = trying(async (photos) => {
  if (tab.mode === "off") setMode("outline");
  const signals = [...$("signals").querySelectorAll(":checked")].map((box) => box.value);
  await server.tell("/api/register", { photos, metric: $("metric").value, solver: $("solver").value, signals });
});

const tasks = {
  register: () => (current()?.camera ? register([tab.photo]) : toast("Four pairs make a pose to start from: pick them first.")),
  registerAll: () => {
    const ready = state.photos.flatMap((photo, i) => (photo.camera && photo.status !== "accepted" ? [i] : []));
    if (ready.length) register(ready);
    else toast("No photo is ready: each needs four pairs first.");
  },
  accept: () => current()?.camera && act({ do: current().camera.accepted ? "reopen" : "accept" }),
  pairsPose: () => act({ do: "pairs" }),
  undo: () => act({ do: "undo" }),
  redo: () => act({ do: "redo" }),
  remove: (id = tab.selected) => id != null && act({ do: "delete", pair: id }),
  rename: (pair, name) => act({ do: "rename", pair, name }),
  select,
  step: (by) => open((tab.photo + by + state.photos.length) % state.photos.length),
  look,
  nextSide: () => modelView.nextSide(),
  roll: (by) => modelView.roll((by * Math.PI) / 2),
  fit: () => {
    photoView.fit();
    modelView.fit();
  },
  nextMode: () => setMode(MODES[(MODES.indexOf(tab.mode) + 1) % MODES.length]),
  nextShading: () => {
    const all = shadings();
    setShading(all[(all.indexOf(tab.shading) + 1) % all.length]);
  },
  nudging: () => tab.nudging,
  nudge: () => {
    if (!current()?.camera) return toast("There is no camera to move yet: pick four pairs first.");
    tab.nudging = !tab.nudging;
    if (tab.nudging && tab.mode === "off") setMode("outline");
    show();
  },
  move: nudge,
  help: () => $("sheet").showModal(),
  escape: () => {
    if (state.job || state.queue.length) return trying(() => server.tell("/api/cancel", {}))();
    if (current()?.pending) {
      tab.ghost = {};
      return act({ do: "drop" });
    }
    tab.nudging = false;
    tab.selected = null;
    show();
  },
};

function setMode(mode) {
  tab.mode = mode;
  show();
}

function setShading(shading) {
  tab.shading = shading;
  show();
}

const shadings = () => [...state.model.shadings, ...(current()?.camera ? ["textured"] : [])];

// ---- what is shown

const photoView = new PhotoView($("photo"), $("photo-loupe"), $("photo-note"), {
  click: clickPhoto,
  select,
  move: (pair, uv, gesture) => movePhotoEnd({ do: "move", pair, uv, gesture }),
});
const modelView = new ModelView($("model"), $("model-loupe"), $("model-note"), {
  click: clickModel,
  select,
  fail,
  miss: () => toast("There is no surface there: click onto the model."),
  move: (pair, xyz, gesture) => moveModelEnd({ do: "move", pair, xyz, gesture }),
});

function background() {
  const colour = getComputedStyle(document.querySelector("#model-pane")).backgroundColor;
  return (colour.match(/[\d.]+/g) ?? [0, 0, 0]).slice(0, 3).join();
}

function show() {
  const photo = current();
  if (!photo) return;
  const atWork = state.job?.photo === tab.photo;
  const { pairs, pending, camera } = photo;
  const opened = tab.opened === tab.photo;
  if (!pairs.some((pair) => pair.id === tab.selected)) tab.selected = null;
  if (tab.shading === "textured" && !camera) tab.shading = "shaded";
  const version = atWork ? `work ${state.job.done}` : JSON.stringify(camera && [camera.R, camera.T, camera.K]);
  photoView.show({ size: photo.size, pairs, pending: pending?.uv, selected: tab.selected, ghost: tab.ghost.photo, camera,
    mode: camera ? tab.mode : "off", blend: $("blend").value / 100, atWork, version });
  modelView.show({ model: state.model, photo: tab.photo, pairs, pending: pending?.xyz, selected: tab.selected,
    ghost: tab.ghost.model, shading: tab.shading, back: background(), dress: tab.shading === "textured" ? version : "" });

  if (atWork) tab.stages[tab.photo] = state.job.stages;
  lists.photos(state, tab.photo, open);
  lists.pairs(photo, tab.selected, tasks);
  lists.outcome(photo, atWork || camera?.verdict ? tab.stages[tab.photo] : null);

  const [words, tone] = next(state, tab.photo, { nudging: tab.nudging, opened });
  $("next").textContent = words;
  $("next").className = tone;
  const busy = Boolean(state.job || state.queue.length);
  $("title").textContent = state.model.file;
  $("title").title = `${state.model.file}: ${state.model.triangles.toLocaleString("en")} triangles`;
  $("undo").disabled = !photo.undo;
  $("redo").disabled = !photo.redo;
  $("register").disabled = !camera || atWork;
  $("register").classList.toggle("prime", photo.status === "picked" && !atWork && (pairs.length >= 6 || camera.source !== "pairs"));
  $("register-all").hidden = state.photos.length < 2;
  $("cancel").hidden = !busy;
  $("accept").disabled = !camera || atWork;
  $("accept").textContent = camera?.accepted ? "Accepted ✓" : "Accept";
  $("accept").classList.toggle("prime", ["registered", "uncertain"].includes(photo.status));
  $("look").disabled = !camera;
  $("nudge").disabled = !camera;
  $("nudge").setAttribute("aria-pressed", tab.nudging);
  $("mode").disabled = !camera;
  $("mode").value = tab.mode;
  $("blend").hidden = tab.mode !== "blend";
  const options = shadings();
  if ($("shading").options.length !== options.length) {
    $("shading").replaceChildren(...options.map((name) => lists.element("option", { value: name }, name)));
  }
  $("shading").value = tab.shading;
  document.title = `${photo.file} · texreg studio`;
  Object.assign(document.documentElement.dataset, { revision: state.revision, status: photo.status, busy });
}

function take(fresh) {
  const first = !state;
  const before = state?.photos[tab.photo];
  state = fresh;
  if (before?.pending && !current()?.pending) tab.ghost = {};
  if (state.notice.id > tab.notice) toast(state.notice.text);
  tab.notice = state.notice.id;
  const pairs = current()?.pairs ?? [];
  if (before && pairs.length > before.pairs.length) tab.selected = pairs.at(-1).id;
  if (before && !before.camera && current()?.camera) {
    if (pairs.length > before.pairs.length) toast("There is a pose. The model is now seen as the photo's camera sees it (C).");
    look();
  }
  if (first) lists.choices(state.choices);
  if (first) open(Math.min(Number(sessionStorage.getItem("photo")) || 0, state.photos.length - 1));
  show();
}

// ---- controls

const buttons = {
  undo: tasks.undo, redo: tasks.redo, register: tasks.register, "register-all": tasks.registerAll, accept: tasks.accept,
  cancel: trying(() => server.tell("/api/cancel", {})), help: tasks.help, look, side: tasks.nextSide, nudge: tasks.nudge,
  "photo-fit": () => photoView.fit(), "model-fit": () => modelView.fit(),
};
for (const [id, task] of Object.entries(buttons)) $(id).onclick = () => task();
$("mode").onchange = () => setMode($("mode").value);
$("blend").oninput = show;
$("shading").onchange = () => setShading($("shading").value);
$("theme").onclick = () => {
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  const now = document.documentElement.dataset.theme ?? (dark ? "dark" : "light");
  theme(now === "dark" ? "light" : "dark");
  show();
};
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);

function theme(name) {
  if (name) document.documentElement.dataset.theme = name;
  if (name) localStorage.setItem("theme", name);
}
theme(localStorage.getItem("theme"));

/** Lets a bar between two parts be dragged, or moved by the arrows. */
function splitter(bar, set) {
  const to = (x) => {
    const box = bar.parentElement.getBoundingClientRect();
    set((x - box.left) / box.width, x - box.left);
  };
  bar.onpointerdown = (event) => bar.setPointerCapture(event.pointerId);
  bar.onpointermove = (event) => bar.hasPointerCapture(event.pointerId) && to(event.clientX);
  bar.onkeydown = (event) => {
    const step = { ArrowLeft: -20, ArrowRight: 20 }[event.key];
    if (step) to(bar.getBoundingClientRect().left + step);
  };
}
splitter($("split"), (share) => {
  const clamped = Math.min(Math.max(share, 0.15), 0.85);
  $("photo-pane").style.setProperty("--share", clamped / (1 - clamped));
});
splitter($("side-split"), (_, width) => document.querySelector("aside").style.setProperty("--side", `${width}px`));

for (const [title, rows] of SHEET) {
  const list = lists.element("dl", {}, ...rows.flatMap(([keys, words]) => [lists.element("dt", {}, keys), lists.element("dd", {}, words)]));
  $("sheet-body").append(lists.element("h3", {}, title), list);
}
keys.listen(tasks);

server.listen(take, (there, words) => {
  document.documentElement.dataset.linked = there;
  if (there) return;
  $("next").textContent = words;
  $("next").className = "bad";
});
