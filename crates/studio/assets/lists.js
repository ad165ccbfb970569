// The lists at the side: photos, pairs, and what came of a registration.

import { STATUS, count, sentence, verdict } from "./words.js";

/** An element with properties, children and data. */
export function element(name, properties = {}, ...children) {
  const { data, ...rest } = properties;
  const made = Object.assign(document.createElement(name), rest);
  Object.assign(made.dataset, data);
  made.append(...children);
  return made;
}

export function photos(state, current, open) {
  const list = document.getElementById("photos");
  const items = state.photos.map((photo, number) => {
    const at = state.job?.photo === number ? "registering…" : state.queue.includes(number) ? "waits" : STATUS[photo.status];
    const item = element("li", { data: { status: photo.status }, title: photo.file, tabIndex: 0, onclick: () => open(number) },
      element("span", { className: "dot" }), element("span", {}, photo.file), element("em", {}, at));
    item.onkeydown = (event) => event.key === "Enter" && open(number);
    item.setAttribute("aria-current", number === current);
    return item;
  });
  const { scrollTop } = list;
  list.replaceChildren(...items);
  list.scrollTop = scrollTop;
  const of = (status) => state.photos.filter((photo) => photo.status === status).length;
  const parts = Object.keys(STATUS).toReversed().map((status) => {
    const part = element("i", { data: { status } });
    part.style.flex = String(of(status));
    return part;
  });
  document.getElementById("bar").replaceChildren(...parts);
  document.getElementById("progress").textContent = `${of("accepted")} of ${state.photos.length} accepted`;
}

export function pairs(photo, selected, tasks) {
  const body = document.querySelector("#pairs tbody");
  // Somebody is writing a name: the list waits.
  if (body.contains(document.activeElement) && document.activeElement.matches("input")) return;
  const rows = photo.pairs.map((pair, i) => {
    const off = pair.residual == null ? "" : `${pair.residual.toFixed(1)} px${pair.suspicious ? " ⚠" : ""}`;
    const name = element("input", { type: "text", value: pair.name, placeholder: "name", maxLength: 60 });
    name.setAttribute("aria-label", `Name of pair ${i + 1}`);
    name.onkeydown = (event) => {
      if (event.key === "Enter") name.blur();
      if (event.key === "Escape") {
        name.value = pair.name;
        name.blur();
      }
      event.stopPropagation();
    };
    name.onblur = () => name.value.trim() !== pair.name && tasks.rename(pair.id, name.value);
    const gone = element("button", { textContent: "✕", title: "Delete this pair (Del)", onclick: (event) => {
      event.stopPropagation();
      tasks.remove(pair.id);
    } });
    const row = element("tr", { className: pair.suspicious ? "suspicious" : "", onclick: () => tasks.select(pair.id) },
      element("td", { className: "number" }, String(i + 1)), element("td", {}, name),
      element("td", { className: "off", title: pair.left_out ? "The pose does not rest on this pair" : "Distance from where the camera puts it" }, off),
      element("td", { className: "gone" }, gone));
    row.setAttribute("aria-selected", pair.id === selected);
    return row;
  });
  if (!rows.length) rows.push(element("tr", {}, element("td", { className: "empty" }, "None yet. Four make a pose, six a safe one.")));
  body.replaceChildren(...rows);
  const used = photo.pairs.filter((pair) => pair.residual != null && !pair.left_out);
  const rms = Math.sqrt(used.reduce((sum, pair) => sum + pair.residual ** 2, 0) / used.length);
  document.getElementById("fit").textContent = used.length
    ? `${count(photo.pairs.length, "pair")}, ${rms.toFixed(1)} px off` : count(photo.pairs.length, "pair");
}

/** What can be chosen of a registration; the usual comes first, and of signals none is chosen. */
export function choices({ metric, solver, signals }) {
  for (const [id, names] of Object.entries({ metric, solver })) {
    document.getElementById(id).replaceChildren(...names.map((name) => element("option", { value: name }, name)));
  }
  const box = (name) => element("label", {}, element("input", { type: "checkbox", value: name }), name);
  document.getElementById("signals").append(...signals.map(box));
}

export function outcome(photo, stages) {
  const box = document.getElementById("verdict-box");
  box.dataset.status = photo.status;
  const words = document.getElementById("verdict");
  const status = photo.camera?.verdict ? element("b", {}, `${sentence(STATUS[photo.status])} `) : "";
  words.replaceChildren(status, verdict(photo));
  const reasons = photo.camera?.verdict?.reasons ?? [];
  document.getElementById("reasons").replaceChildren(...reasons.map((reason) => element("li", {}, sentence(reason))));
  document.getElementById("curve").replaceChildren(...(stages?.length ? [curve(stages)] : []));
}

/** The metric, stage by stage: from its value before to its value after. The search has a measure of its own and is left out. */
function curve(stages) {
  const climbs = stages.filter((stage) => stage.name.startsWith("climb"));
  const svg = (name, attributes, ...children) => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...children);
    return made;
  };
  const values = climbs.flatMap((stage) => [stage.start, stage.end]);
  const [low, high] = [Math.min(...values, Infinity), Math.max(...values, -Infinity)];
  const y = (value) => 70 - 58 * ((value - low) / Math.max(high - low, 1e-9));
  const step = 250 / Math.max(climbs.length, 1);
  const lines = climbs.flatMap((stage, i) => {
    const [from, to] = [28 + i * step + 2, 28 + (i + 1) * step - 6];
    return [
      svg("polyline", { points: `${from},${y(stage.start)} ${to},${y(stage.end)}` }),
      svg("text", { x: (from + to) / 2, y: 88, "text-anchor": "middle" }, stage.name.replace("climb ", "")),
    ];
  });
  const scale = climbs.length
    ? [svg("text", { x: 0, y: y(high) + 4 }, high.toFixed(2)), svg("text", { x: 0, y: y(low) + 4 }, low.toFixed(2))] : [];
  return svg("svg", { viewBox: "0 0 280 92", role: "img", "aria-label": "The metric, level by level" },
    svg("line", { x1: 28, y1: 74, x2: 278, y2: 74 }), ...scale, ...lines);
}
