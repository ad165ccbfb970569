// The photo: panned and zoomed here, pixel by pixel where it is large. Its pixel (u, v) has its centre at
// ((u + ½) s + x, (v + ½) s + y) in CSS pixels.

import { picture } from "./server.js";
import { clamp } from "./maths.js";
import { fitted, watch } from "./pointer.js";
import * as markers from "./markers.js";
import * as loupe from "./loupe.js";
import { Overlay } from "./overlay.js";

/** From this many CSS pixels a pixel on, its borders are seen. */
const SHARP = 2;

export class PhotoView {
  constructor(canvas, magnifier, note, tasks) {
    Object.assign(this, { canvas, magnifier, note, tasks });
    this.context = canvas.getContext("2d");
    this.number = null;
    this.size = null;
    this.bitmap = null;
    this.part = null;
    this.view = { s: 1, x: 0, y: 0 };
    this.whole = true;
    this.pairs = [];
    this.overlay = new Overlay(() => this.draw());
    fitted(canvas, () => {
      if (this.whole) this.fit();
      this.changed();
    });
    watch(canvas, {
      grab: (at) => this.grab(at),
      drag: (by) => this.pan(by),
      pan: (by) => this.pan(by),
      zoom: (factor, at) => this.zoom(factor, at),
      click: (at) => this.bitmap && this.inside(this.pixel(at)) && tasks.click(this.pixel(at)),
      hover: (at) => this.hover(at),
    });
  }

  /** Shows a photo. */
  async open(number) {
    this.number = number;
    [this.bitmap, this.size, this.part] = [null, null, null];
    this.overlay.clear();
    this.draw();
    const { bitmap } = await picture(`/api/photo/${number}/preview`);
    if (this.number !== number) return;
    this.bitmap = bitmap;
    if (this.size) this.fit();
    this.changed();
  }

  /** Takes over what is known. */
  show({ size, pairs, pending, selected, ghost, camera, mode, blend, atWork, version }) {
    const first = !this.size && size;
    Object.assign(this, { size, pairs, pending, selected, ghost });
    if (first && this.bitmap) this.fit();
    const key = camera && `${this.number} ${version}`;
    this.overlay.show({ number: this.number, key, mode, blend, atWork });
    this.changed();
  }

  get box() {
    const ratio = devicePixelRatio || 1;
    return [this.canvas.width / ratio, this.canvas.height / ratio];
  }

  screen([u, v]) {
    const { s, x, y } = this.view;
    return [(u + 0.5) * s + x, (v + 0.5) * s + y];
  }

  pixel([a, b]) {
    const { s, x, y } = this.view;
    return [(a - x) / s - 0.5, (b - y) / s - 0.5];
  }

  inside([u, v]) {
    return this.size && u >= -0.5 && v >= -0.5 && u <= this.size[0] - 0.5 && v <= this.size[1] - 0.5;
  }

  fit() {
    if (!this.size) return;
    const [width, height] = this.box;
    const s = Math.min(width / this.size[0], (height - 52) / this.size[1]) * 0.98;
    this.view = { s, x: (width - s * this.size[0]) / 2, y: 52 + (height - 52 - s * this.size[1]) / 2 };
    this.whole = true;
    this.changed();
  }

  pan([dx, dy]) {
    this.view = { ...this.view, x: this.view.x + dx, y: this.view.y + dy };
    this.moved();
  }

  zoom(factor, [a, b]) {
    const s = clamp(this.view.s * factor, 0.02, 64);
    const k = s / this.view.s;
    this.view = { s, x: a - (a - this.view.x) * k, y: b - (b - this.view.y) * k };
    this.moved();
  }

  /** Brings a pixel into sight. */
  reveal(uv) {
    const [width, height] = this.box;
    const [a, b] = this.screen(uv);
    if (a > 0.15 * width && a < 0.85 * width && b > 0.2 * height && b < 0.85 * height) return;
    this.pan([width / 2 - a, height / 2 - b]);
  }

  moved() {
    this.whole = false;
    this.hoverPixel = null;
    this.changed();
  }

  changed() {
    this.canvas.dataset.view = JSON.stringify(this.view);
    this.draw();
    this.wantPart();
    this.wantOverlay();
  }

  wantOverlay() {
    if (!this.size) return;
    const [width, height] = this.box;
    const [left, top] = this.pixel([0, 0]).map((x) => x + 0.5);
    this.overlay.want({ left, top, width: width / this.view.s, height: height / this.view.s },
      [this.canvas.width, this.canvas.height]);
  }

  /** Asks for the part in sight of a photo whose picture is reduced, when it is looked at closely. */
  wantPart() {
    if (!this.bitmap || !this.size) return;
    const step = this.size[0] / this.bitmap.width;
    if (step <= 1 || this.view.s * (devicePixelRatio || 1) * step <= 1.2) {
      this.part = null;
      return;
    }
    clearTimeout(this.partTimer);
    this.partTimer = setTimeout(async () => {
      const [width, height] = this.box;
      const [low, high] = [this.pixel([0, 0]), this.pixel([width, height])];
      const left = clamp(Math.floor(low[0] - 8), 0, this.size[0] - 1);
      const top = clamp(Math.floor(low[1] - 8), 0, this.size[1] - 1);
      const right = clamp(Math.ceil(high[0] + 8), left + 1, this.size[0]);
      const bottom = clamp(Math.ceil(high[1] + 8), top + 1, this.size[1]);
      const known = this.part;
      if (known && left >= known.left && top >= known.top && right <= known.left + known.width
        && bottom <= known.top + known.height) return;
      const number = this.number;
      const part = { left, top, width: right - left, height: bottom - top };
      if (part.width * part.height > 12e6) return;
      const { bitmap } = await picture(`/api/photo/${number}/part`, part);
      if (this.number !== number) return;
      this.part = { ...part, bitmap };
      this.draw();
    }, 80);
  }

  label(at) {
    const pair = this.pairs[at];
    return pair.name || String(at + 1);
  }

  grab(at) {
    const near = (pair) => Math.hypot(...this.screen(pair.uv).map((x, k) => x - at[k])) < 12;
    const pair = this.pairs.find((pair) => pair.id === this.selected && near(pair)) ?? this.pairs.find(near);
    if (!pair) return null;
    const from = pair.uv;
    const gesture = Math.floor(Math.random() * 2 ** 50);
    const moved = (by) => from.map((x, k) => x + by[k] / this.view.s);
    return {
      move: (by) => {
        pair.uv = moved(by);
        this.dragged = pair.uv;
        this.draw();
        this.tasks.move(pair.id, pair.uv, gesture);
      },
      end: () => {
        this.dragged = null;
        this.tasks.move(pair.id, pair.uv, gesture, true);
      },
      click: () => this.tasks.select(pair.id),
    };
  }

  hover(at) {
    this.hoverPixel = at;
    const uv = at && this.pixel(at);
    const here = uv && this.bitmap && this.inside(uv);
    this.note.textContent = here ? `${uv[0].toFixed(1)}, ${uv[1].toFixed(1)} px · ${(this.view.s * 100).toFixed(0)} %` : "";
    loupe.show(this.magnifier, this.canvas, here ? at : null, (context, size) => {
      const scale = Math.max(this.view.s * loupe.TIMES, 4) * (devicePixelRatio || 1);
      context.imageSmoothingEnabled = false;
      const origin = (k) => size / 2 - ((this.dragged ?? uv)[k] + 0.5) * scale;
      this.paint(context, origin(0), origin(1), scale);
    });
  }

  /** The photo with its corner at (x, y), so many pixels a pixel. */
  paint(context, x, y, s) {
    context.drawImage(this.bitmap, x, y, this.size[0] * s, this.size[1] * s);
    const { part } = this;
    if (part) context.drawImage(part.bitmap, x + part.left * s, y + part.top * s, part.width * s, part.height * s);
  }

  draw() {
    if (this.frame) return;
    this.frame = requestAnimationFrame(() => {
      this.frame = null;
      this.drawNow();
    });
  }

  drawNow() {
    const { context, view } = this;
    const ratio = devicePixelRatio || 1;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    if (!this.bitmap || !this.size) return;
    context.imageSmoothingEnabled = view.s < SHARP;
    context.imageSmoothingQuality = "high";
    this.paint(context, view.x, view.y, view.s);
    this.overlay.draw(context, view, this.box);
    this.pairs.forEach((pair, i) => {
      const at = this.screen(pair.uv);
      if (pair.predicted) markers.predicted(context, this.screen(pair.predicted), at, pair.suspicious);
      markers.end(context, at, this.label(i), { selected: pair.id === this.selected, suspicious: pair.suspicious });
    });
    if (this.pending) markers.pending(context, this.screen(this.pending));
    if (this.ghost) markers.ghost(context, this.screen(this.ghost));
  }
}
