// The model over the photo, as the photo's camera sees it: pictures of the part in sight, made by the server, laid over in one of
// four ways.

import { picture } from "./server.js";

const CHECKER = 48;
const FLICKER = 600;
const LINE = { light: "40,230,160", work: "255,168,30" };

export class Overlay {
  constructor(changed) {
    this.changed = changed;
    this.mode = "off";
    this.blend = 0.5;
    this.on = true;
    this.clear();
    setInterval(() => {
      if (this.mode !== "flicker" || !this.image) return;
      this.on = !this.on;
      this.changed();
    }, FLICKER);
  }

  clear() {
    this.image = null;
    this.key = null;
  }

  /** What to show of which camera; `key` changes whenever that does, and is null without one. */
  show({ number, key, mode, blend, atWork }) {
    if (!key || mode === "off" || (this.image && this.image.kind !== kind(mode))) this.image = null;
    Object.assign(this, { number, key, mode, blend, atWork });
    this.on = true;
  }

  /** Asks for the part of the photo that is in sight, unless it is there or on its way. */
  want(window, [width, height]) {
    if (!this.key || this.mode === "off") return;
    const wish = JSON.stringify([this.key, kind(this.mode), this.atWork, window, width, height]);
    if (wish === this.wish) return;
    this.wish = wish;
    this.next = { wish, window, width, height, key: this.key, kind: kind(this.mode), atWork: this.atWork, number: this.number };
    this.pump();
  }

  async pump() {
    if (this.busy || !this.next) return;
    this.busy = true;
    const { wish, window, width, height, key, kind, atWork, number } = this.next;
    this.next = null;
    try {
      // A line as fine as a screen's finest pixel would not be seen.
      const fine = kind === "outline" ? 1 / Math.max(1, devicePixelRatio) : 1;
      const scale = Math.min(fine, Math.sqrt(4e6 / (width * height)));
      const parameters = { ...window, w: Math.round(width * scale), h: Math.round(height * scale), kind,
        colour: atWork ? LINE.work : LINE.light, at_work: atWork };
      const { bitmap } = await picture(`/api/photo/${number}/overlay`, parameters);
      if (number === this.number && this.key && kind === kindOf(this)) this.image = { bitmap, window, kind, key };
      this.changed();
    } catch {
      if (this.wish === wish) this.wish = null;
    } finally {
      this.busy = false;
      this.pump();
    }
  }

  /** Lays it over a photo drawn with its corner at (x, y), s CSS pixels a pixel. */
  draw(context, { s, x, y }, [width, height]) {
    if (!this.image || this.mode === "off" || !this.on) return;
    const { bitmap, window } = this.image;
    const place = [x + window.left * s, y + window.top * s, window.width * s, window.height * s];
    context.save();
    if (this.mode === "blend") context.globalAlpha = this.blend;
    if (this.mode === "checker") {
      context.beginPath();
      for (let row = 0; row * CHECKER < height; row++) {
        for (let column = row % 2; column * CHECKER < width; column += 2) {
          context.rect(column * CHECKER, row * CHECKER, CHECKER, CHECKER);
        }
      }
      context.clip();
    }
    context.drawImage(bitmap, ...place);
    context.restore();
  }
}

const kind = (mode) => (mode === "outline" ? "outline" : "shaded");
const kindOf = (overlay) => kind(overlay.mode);
