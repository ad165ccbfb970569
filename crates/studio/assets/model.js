// The model: pictures from the server, while somebody turns, shifts and zooms it here. A camera is a rotation `r`, the point it
// turns about, its distance, and a focal length over the pane's shorter side.

import { ask, picture } from "./server.js";
import { apply, clamp, cross, minus, multiply, plus, project, times, transposed, turn } from "./maths.js";
import { fitted, watch } from "./pointer.js";
import * as markers from "./markers.js";
import * as loupe from "./loupe.js";

/** Milliseconds from the hand to the picture; what is drawn meanwhile is as coarse as it has to be. */
const PROMPT = 40;
/** Milliseconds without motion after which the picture is drawn in full. */
const SETTLED = 120;

/** Sides to begin with: for each axis that may point up, four times round. */
const SIDES = [
  ["y", [0, 1, 0], [[0, 0, -1], [-1, 0, 0], [0, 0, 1], [1, 0, 0]]],
  ["z", [0, 0, 1], [[0, 1, 0], [-1, 0, 0], [0, -1, 0], [1, 0, 0]]],
  ["−y", [0, -1, 0], [[0, 0, 1], [-1, 0, 0], [0, 0, -1], [1, 0, 0]]],
].flatMap(([name, up, views]) => views.map((forward) => {
  const down = times(up, -1);
  return { name, r: [...cross(down, forward), ...down, ...forward] };
}));

export class ModelView {
  constructor(canvas, magnifier, note, tasks) {
    Object.assign(this, { canvas, magnifier, note, tasks });
    this.context = canvas.getContext("2d");
    this.side = -1;
    this.pairs = [];
    this.visible = "";
    this.coarse = 0.5;
    this.shading = "shaded";
    fitted(canvas, () => this.moved());
    watch(canvas, {
      grab: (at) => this.grab(at),
      drag: (by, at, keys) => this.drag(by, at, keys),
      pan: (by) => this.pan(by),
      zoom: (factor, at) => this.zoom(factor, at),
      click: (at) => this.pick(at),
      hover: (at) => this.hover(at),
      rest: () => this.moved(),
    });
  }

  /** Takes over what is known. */
  show({ model, photo, pairs, pending, selected, ghost, shading, back, dress }) {
    const again = shading !== this.shading || back !== this.back || photo !== this.photo || dress !== this.dress
      || pairs.length !== this.pairs.length;
    Object.assign(this, { photo, pairs, pending, selected, ghost, shading, back, dress });
    if (!this.model) {
      this.model = model;
      this.nextSide();
    } else if (again) this.moved(true);
    this.draw();
  }

  get box() {
    const ratio = devicePixelRatio || 1;
    return [this.canvas.width / ratio, this.canvas.height / ratio];
  }

  /** The camera as the server and `project` want it, for a picture of this size. */
  lens([width, height] = this.box) {
    const { r, target, distance, focal } = this.camera;
    const t = plus(times(apply(r, target), -1), [0, 0, distance]);
    return { r, t, f: focal * Math.min(width, height), cx: (width - 1) / 2, cy: (height - 1) / 2, w: width, h: height };
  }

  nextSide() {
    this.side = (this.side + 1) % SIDES.length;
    const { r, name } = SIDES[this.side];
    this.camera = { r, target: this.model.centre, distance: 1, focal: 1.3 };
    this.fit();
    this.note.textContent = `${name} up`;
  }

  fit() {
    if (!this.model) return;
    const [width, height] = this.box;
    const share = Math.min(width, height - 60) / Math.min(width, height);
    this.camera.target = this.model.centre;
    this.camera.distance = (this.camera.focal * this.model.diagonal * 0.92) / clamp(share, 0.3, 1);
    this.moved();
  }

  /** As a photo of this size sees it. */
  look({ R, T, K }, [width, height]) {
    const r = R.flat();
    const centre = plus(apply(r, this.model.centre), T);
    const box = this.box;
    const scale = Math.min(box[0] / width, box[1] / height);
    const distance = Math.max(centre[2], 1e-6 * this.model.diagonal);
    const eye = times(apply(transposed(r), T), -1);
    // The point on the axis at the depth of the model's middle.
    const target = plus(eye, apply(transposed(r), [0, 0, distance]));
    this.camera = { r, target, distance, focal: (K.fx * scale) / Math.min(...box) };
    this.note.textContent = "as the photo's camera";
    this.moved();
  }

  drag(by, at, { shift, roll }) {
    if (!this.camera) return;
    this.note.textContent = "";
    const [width, height] = this.box;
    if (shift) return this.pan(by);
    const unit = 3 / Math.min(width, height);
    let step = turn([-by[1] * unit, by[0] * unit, 0]);
    if (roll) {
      const from = [at[0] - by[0] - width / 2, at[1] - by[1] - height / 2];
      const to = [at[0] - width / 2, at[1] - height / 2];
      step = turn([0, 0, Math.atan2(from[0] * to[1] - from[1] * to[0], from[0] * to[0] + from[1] * to[1])]);
    }
    this.camera.r = multiply(step, this.camera.r);
    this.moved();
  }

  pan([dx, dy]) {
    if (!this.camera) return;
    const { r, distance } = this.camera;
    const unit = distance / this.lens().f;
    this.camera.target = minus(this.camera.target, apply(transposed(r), [dx * unit, dy * unit, 0]));
    this.moved();
  }

  zoom(factor, [a, b]) {
    if (!this.camera) return;
    const { cx, cy, f } = this.lens();
    const { r, distance } = this.camera;
    const closer = clamp(distance / factor, 1e-4 * this.model.diagonal, 50 * this.model.diagonal);
    const unit = (distance - closer) / f;
    this.camera.target = plus(this.camera.target, apply(transposed(r), [(a - cx) * unit, (b - cy) * unit, 0]));
    this.camera.distance = closer;
    this.moved();
  }

  roll(angle) {
    this.camera.r = multiply(turn([0, 0, angle]), this.camera.r);
    this.moved();
  }

  /** Brings a point of the world into sight. */
  reveal(point) {
    const lens = this.lens();
    const at = project(lens, point);
    const inside = (x, size) => x > 0.15 * size && x < 0.85 * size;
    if (at && inside(at[0], lens.w) && inside(at[1], lens.h)) return;
    const depth = plus(apply(lens.r, point), lens.t)[2];
    Object.assign(this.camera, { target: point, distance: depth > 0 ? depth : this.camera.distance });
    this.moved();
  }

  /** The camera or what it shows has changed: a coarse picture now, a fine one later. */
  moved(inPlace = false) {
    if (!this.camera) return;
    delete this.canvas.dataset.still;
    clearTimeout(this.settle);
    this.settle = setTimeout(() => this.ask(true), inPlace ? 0 : SETTLED);
    if (inPlace) return;
    this.ask(false);
    this.hovered = null;
    loupe.show(this.magnifier, this.canvas, null);
  }

  ask(full) {
    this.wanted = { full };
    this.pump();
  }

  /** One picture at a time; what was wanted meanwhile, last, comes next. */
  async pump() {
    if (this.busy || !this.wanted || !this.camera) return;
    this.busy = true;
    const { full } = this.wanted;
    this.wanted = null;
    const lens = this.lens();
    const ratio = (devicePixelRatio || 1) * (full ? 1 : this.coarse);
    const began = performance.now();
    try {
      const { bitmap, headers } = await picture("/api/frame", { ...this.parameters(lens, ratio), quality: full ? 92 : 75 });
      const spent = performance.now() - began;
      if (!full) this.coarse = clamp(this.coarse * Math.sqrt(PROMPT / spent), 0.15, 1);
      this.canvas.dataset.spent = spent.toFixed(1);
      this.shown = { bitmap, lens };
      this.visible = headers.get("x-visible") ?? "";
      if (full && !this.wanted) this.canvas.dataset.still = "1";
    } catch (error) {
      this.tasks.fail(error);
    }
    this.busy = false;
    this.draw();
    this.pump();
  }

  parameters(lens, ratio, size = [lens.w, lens.h]) {
    return {
      r: lens.r.join(), t: lens.t.join(), f: lens.f * ratio,
      w: Math.max(1, Math.round(size[0] * ratio)), h: Math.max(1, Math.round(size[1] * ratio)),
      shading: this.shading, photo: this.photo, back: this.back,
    };
  }

  async pick([a, b]) {
    if (!this.shown) return;
    const { lens } = this.shown;
    try {
      const { xyz } = await ask("/api/pick", { r: lens.r.join(), t: lens.t.join(), f: lens.f, w: Math.round(lens.w),
        h: Math.round(lens.h), cx: lens.cx, cy: lens.cy, x: a - 0.5, y: b - 0.5 });
      if (xyz) this.tasks.click(xyz);
      else this.tasks.miss();
    } catch (error) {
      this.tasks.fail(error);
    }
  }

  screen(point) {
    const at = this.shown && project(this.shown.lens, point);
    return at && [at[0] + 0.5, at[1] + 0.5];
  }

  grab(at) {
    const near = (pair, i) => {
      const place = this.visible[i] !== "0" && this.screen(pair.xyz);
      return place && Math.hypot(place[0] - at[0], place[1] - at[1]) < 12;
    };
    const pair = this.pairs.find((pair, i) => pair.id === this.selected && near(pair, i)) ?? this.pairs.find(near);
    if (!pair) return null;
    const from = this.screen(pair.xyz);
    const gesture = Math.floor(Math.random() * 2 ** 50);
    const { lens } = this.shown;
    const drop = async (by, last) => {
      const [x, y] = [from[0] + by[0] - 0.5, from[1] + by[1] - 0.5];
      const { xyz } = await ask("/api/pick", { r: lens.r.join(), t: lens.t.join(), f: lens.f, w: Math.round(lens.w),
        h: Math.round(lens.h), cx: lens.cx, cy: lens.cy, x, y });
      if (xyz) this.tasks.move(pair.id, xyz, gesture, last);
    };
    let last = [0, 0];
    let asking = false;
    return {
      move: async (by) => {
        last = by;
        if (asking) return;
        asking = true;
        await drop(by, false).catch(this.tasks.fail);
        asking = false;
      },
      end: () => drop(last, true).catch(this.tasks.fail),
      click: () => this.tasks.select(pair.id),
    };
  }

  hover(at) {
    this.hovered = at;
    clearTimeout(this.sharpen);
    const { shown } = this;
    if (!at || !shown || !this.canvas.dataset.still) return loupe.show(this.magnifier, this.canvas, null);
    loupe.show(this.magnifier, this.canvas, at, (context, size) => {
      const ratio = (devicePixelRatio || 1) * loupe.TIMES;
      context.drawImage(shown.bitmap, size / 2 - at[0] * ratio, size / 2 - at[1] * ratio, shown.lens.w * ratio, shown.lens.h * ratio);
    });
    // The enlarged picture is soon replaced by one drawn at that size.
    this.sharpen = setTimeout(async () => {
      const { lens } = shown;
      const ratio = loupe.TIMES * (devicePixelRatio || 1);
      const side = 176 / loupe.TIMES;
      const parameters = this.parameters(lens, ratio, [side, side]);
      const shifted = (centre, x) => (centre + 0.5 - x + side / 2) * ratio - 0.5;
      const close = { ...parameters, cx: shifted(lens.cx, at[0]), cy: shifted(lens.cy, at[1]), quality: 90 };
      try {
        const { bitmap } = await picture("/api/frame", close);
        if (this.hovered !== at || this.shown !== shown) return;
        loupe.show(this.magnifier, this.canvas, at, (context, size) => context.drawImage(bitmap, 0, 0, size, size));
      } catch {
        // The enlarged picture stays.
      }
    }, 90);
  }

  draw() {
    if (this.frame) return;
    this.frame = requestAnimationFrame(() => {
      this.frame = null;
      this.drawNow();
    });
  }

  drawNow() {
    const { context, shown } = this;
    if (!shown) return;
    const ratio = devicePixelRatio || 1;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.imageSmoothingQuality = "high";
    context.drawImage(shown.bitmap, 0, 0, this.canvas.width, this.canvas.height);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.canvas.dataset.view = JSON.stringify(shown.lens);
    this.pairs.forEach((pair, i) => {
      const at = this.screen(pair.xyz);
      const hidden = this.visible[i] === "0";
      const label = pair.name || String(i + 1);
      if (at) markers.end(context, at, label, { selected: pair.id === this.selected, suspicious: pair.suspicious, hidden });
    });
    const pending = this.pending && this.screen(this.pending);
    if (pending) markers.pending(context, pending);
    const ghost = this.ghost && this.screen(this.ghost);
    if (ghost) markers.ghost(context, ghost);
  }
}
