// The camera's picture with an SVG overlay: click to look there, tap a face to follow it.
const by = (id) => document.getElementById(id);
const SVG = "http://www.w3.org/2000/svg";

export class CameraPicture {
  /**
   * @param {(u: number, v: number, stamp: string) => void} look receives a place in the picture, in shares.
   * @param {(frame: string) => void} follow receives the frame of a face.
   */
  constructor(look, follow) {
    this.image = by("picture");
    this.follow = follow;
    this.times = [];
    this.faces = new Map();
    by("camera").addEventListener("click", (event) => {
      if (event.target.closest("button") || !this.image.naturalWidth) return;
      const inner = this.inner(), outer = by("camera").getBoundingClientRect();
      const u = (event.clientX - outer.left - inner.left) / inner.width;
      const v = (event.clientY - outer.top - inner.top) / inner.height;
      if (u >= 0 && u <= 1 && v >= 0 && v <= 1) look(u, v, this.stamp);
    });
  }

  async show(data) {
    this.stamp = new DataView(data).getBigInt64(0, true).toString();
    const url = URL.createObjectURL(new Blob([data.slice(16)], { type: "image/jpeg" }));
    const before = this.image.src;
    this.image.src = url;
    await this.image.decode().catch(() => {});
    if (before) URL.revokeObjectURL(before);
    const now = performance.now();
    this.times = [...this.times.filter((time) => now - time < 2000), now];
    by("fps").textContent = `Live · ${Math.round(this.times.length / 2)} fps`;
  }

  /** Return where the picture is inside its card. */
  inner() {
    const { clientWidth, clientHeight } = by("camera");
    const { naturalWidth: across, naturalHeight: down } = this.image;
    const scale = Math.min(clientWidth / across, clientHeight / down);
    const width = across * scale, height = down * scale;
    return { left: (clientWidth - width) / 2, top: (clientHeight - height) / 2, width, height };
  }

  mark(faces, mode) {
    if (!this.image.naturalWidth) return;
    const inner = this.inner();
    for (const id of ["overlay", "labels"]) for (const [key, value] of Object.entries(inner)) by(id).style[key] = `${value}px`;
    const seen = new Set(faces.map((face) => face.frame));
    for (const [frame, { box, label }] of this.faces) if (!seen.has(frame)) { box.remove(); label.remove(); this.faces.delete(frame); }
    for (const [number, face] of faces.entries()) {
      const { box, label } = this.faces.get(face.frame) ?? this.add(face.frame);
      const [x, y, width, height] = face.box;
      for (const [key, value] of Object.entries({ x, y, width, height })) box.setAttribute(key, value);
      box.classList.toggle("on", mode === "face" && number === 0);
      label.classList.toggle("on", mode === "face" && number === 0);
      label.style.left = `${100 * x}%`;
      label.style.top = `${100 * y}%`;
      label.textContent = `${face.frame.replaceAll("_", " ")} · ${face.distance.toFixed(1)} m`;
    }
  }

  add(frame) {
    const box = by("overlay").appendChild(document.createElementNS(SVG, "rect"));
    box.setAttribute("rx", 0.02);
    const label = by("labels").appendChild(document.createElement("button"));
    label.onclick = () => this.follow(frame);
    this.faces.set(frame, { box, label });
    return this.faces.get(frame);
  }
}
