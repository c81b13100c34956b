// The camera picture with boxes: click to look there, drag to look around, tap a person to follow.
import { button, by, element, write } from "./dom.js";

const DRAG = 6, MOST_CROPPED = 1.35, DECODING = 1000, OLD = 3000; // pixels, ratio, ms: a picture that is replaced may never be decoded

export class CameraPicture {
  /** `look` receives a place in the picture (u, v in fractions, and its stamp), `follow` the box of a person; see `mark`. */
  constructor(look, follow) {
    this.image = by("picture");
    this.look = look;
    this.follow = follow;
    this.times = [];
    this.faces = new Map();
    this.layout = "";
    this.size = null; // of the picture that is shown: while the next one loads, the element has none
    const card = by("camera");
    card.addEventListener("pointerdown", (event) => {
      if (event.button || event.target.closest("button, label")) return;
      this.pressed = { x: event.clientX, y: event.clientY };
      card.setPointerCapture(event.pointerId);
    });
    card.addEventListener("pointermove", (event) => {
      if (!this.pressed) return;
      const moved = Math.hypot(event.clientX - this.pressed.x, event.clientY - this.pressed.y) > DRAG;
      this.pressed.dragged ||= moved;
      if (this.pressed.dragged) this.point(event);
    });
    card.addEventListener("pointerup", (event) => {
      if (this.pressed) this.point(event, !this.pressed.dragged);
      this.pressed = null;
    });
    card.addEventListener("pointercancel", () => this.release());
    new ResizeObserver(() => this.place()).observe(card);
  }

  /** End a drag. */
  release() { this.pressed = null; }

  /** Look at a place in the picture, or follow the person there. */
  point(event, tapped = false) {
    if (!this.size) return;
    const inner = this.inner(), outer = by("camera").getBoundingClientRect();
    const u = (event.clientX - outer.left - inner.left) / inner.width;
    const v = (event.clientY - outer.top - inner.top) / inner.height;
    if (u < 0 || u > 1 || v < 0 || v > 1) return;
    const inside = ({ one: { frame, box: [x, y, width, height] } }) => frame && u >= x && u <= x + width && v >= y && v <= y + height;
    const person = tapped && [...this.faces.values()].find(inside);
    if (person) this.follow(person.one); else this.look(u, v, this.stamp);
  }

  async show(data) {
    this.stamp = new DataView(data).getBigInt64(0, true).toString();
    await this.showBlob(new Blob([data.slice(8)], { type: "image/jpeg" }));
    if (!this.image.src) return; // cleared meanwhile
    const now = performance.now();
    this.times = [...this.times.filter((time) => now - time < 2000), now];
    write(by("fps"), `Live · ${Math.round(this.times.length / 2)} fps`);
  }

  /** Say so when no more pictures come: the last one stays. */
  checkAge() {
    if (!this.times.length || performance.now() - this.times.at(-1) < OLD) return;
    this.times = [];
    write(by("fps"), "no new picture");
  }

  async showBlob(blob, text = "") {
    if (text) { write(by("fps"), text); this.times = []; }
    const before = this.image.src;
    this.image.src = URL.createObjectURL(blob);
    await Promise.race([this.image.decode().catch(() => {}), new Promise((end) => setTimeout(end, DECODING))]);
    if (before) URL.revokeObjectURL(before);
    if (this.image.naturalWidth) this.size = [this.image.naturalWidth, this.image.naturalHeight];
    this.place();
  }

  clear() {
    if (this.image.src) URL.revokeObjectURL(this.image.src);
    this.image.removeAttribute("src");
    this.size = null;
    this.times = [];
    write(by("fps"), "no picture");
    this.mark([]);
  }

  /** Return where the picture is inside its card. It covers the card, unless too much would be cropped. */
  inner() {
    const { clientWidth, clientHeight } = by("camera");
    const [across, down] = this.size;
    const scales = [clientWidth / across, clientHeight / down], [least, most] = [Math.min(...scales), Math.max(...scales)];
    const scale = most / least < MOST_CROPPED ? most : least;
    const width = across * scale, height = down * scale;
    return { left: (clientWidth - width) / 2, top: (clientHeight - height) / 2, width, height };
  }

  /** Put the overlay over the picture where that has moved. */
  place() {
    if (!this.size) return;
    const inner = this.inner(), layout = JSON.stringify(inner);
    if (layout === this.layout) return;
    this.layout = layout;
    for (const id of ["picture", "overlay", "labels"]) for (const [key, value] of Object.entries(inner)) by(id).style[key] = `${value}px`;
  }

  /** Mark persons and the followed target; the box of the target has no frame. */
  mark(boxes) {
    this.place(); // a tab that has just been opened has its size now
    if (!this.size) boxes = [];
    const seen = new Set(boxes.map((one) => one.frame));
    for (const [frame, { box, label }] of this.faces) if (!seen.has(frame)) { box.remove(); label.remove(); this.faces.delete(frame); }
    const { clientWidth: across, clientHeight: down, offsetLeft, offsetTop } = by("labels");
    const visible = { left: Math.max(0, -offsetLeft), top: Math.max(0, -offsetTop), across, down };
    const taken = boxes.map(({ box: [x, y, width, height] }) => ({ x: x * across, y: y * down, width: width * across, height: height * down }));
    for (const [number, one] of boxes.entries()) {
      const face = this.faces.get(one.frame) ?? this.add(one.frame);
      const [x, y, width, height] = one.box;
      face.one = one;
      for (const [key, value] of Object.entries({ x, y, width, height })) face.box.setAttribute(key, value);
      face.label.hidden = x > 1 || x + width < 0;
      write(face.label, one.distance === null ? one.label : `${one.label} · ${one.distance.toFixed(1)} m`);
      if (!face.label.hidden) taken.push(this.placeLabel(face, taken[number], taken, visible));
    }
  }

  /** Put a label where it overlaps the least: above its box, below it or beside it; return where. */
  placeLabel(face, box, taken, { left, top, across, down }) {
    const size = { width: face.label.offsetWidth, height: face.label.offsetHeight };
    const spots = [[box.x, box.y - size.height], [box.x, box.y + box.height], [box.x + box.width, box.y], [box.x - size.width, box.y]].map(([x, y]) => ({
      x: Math.max(left, Math.min(x, across - left - size.width)), y: Math.max(top, Math.min(y, down - top - size.height)), ...size,
    }));
    const hides = (spot) => taken.reduce((sum, one) => sum + overlap(spot, one), 0);
    const least = Math.min(...spots.map(hides));
    if (!spots[face.side] || hides(spots[face.side]) > least) face.side = spots.findIndex((spot) => hides(spot) === least); // no change without need
    const spot = spots[face.side];
    face.label.style.left = `${spot.x}px`;
    face.label.style.top = `${spot.y}px`;
    return spot;
  }

  add(frame) {
    const box = element(by("overlay"), "rect", { rx: 0.02 });
    const label = frame ? button(by("labels"), "", () => this.follow(this.faces.get(frame).one)) : element(by("labels"), "p");
    if (!frame) for (const node of [box, label]) node.classList.add("on");
    this.faces.set(frame, { box, label });
    return this.faces.get(frame);
  }
}

/** Return by how much two rectangles overlap [square pixels]. */
function overlap(one, other) {
  const across = Math.min(one.x + one.width, other.x + other.width) - Math.max(one.x, other.x);
  const down = Math.min(one.y + one.height, other.y + other.height) - Math.max(one.y, other.y);
  return Math.max(0, across) * Math.max(0, down);
}
