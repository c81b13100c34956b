// Mode cards with their options, and the pad for pan and tilt.
import { by, command, element, latestOnly, offer, rows, write } from "./dom.js";

const ICONS = {
  face: "M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18Zm-3 7v1m6-1v1m-6.5 4a5 5 0 0 0 7 0", ball: "M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18Zm0 0v18M3 12h18M6 5.5c4 3.5 4 9.5 0 13m12-13c-4 3.5-4 9.5 0 13",
  marker: "M4 4h6v6H4zm10 0h6v6h-6zM4 14h6v6H4zm10 0h2v2h-2zm4 4h2v2h-2z", point: "M12 2v4m0 12v4M2 12h4m12 0h4m-10-5a5 5 0 1 0 0 10 5 5 0 0 0 0-10Z",
  track: "M12 2v4m0 12v4M2 12h4m12 0h4m-10-1a1 1 0 1 0 0 2 1 1 0 0 0 0-2Z", path: "M7 8c-6 0-6 8 0 8 5 0 5-8 10-8 6 0 6 8 0 8-5 0-5-8-10-8Z", nothing: "M4 4l16 16M8 11V6a1.5 1.5 0 0 1 3 0m0 2V4.5a1.5 1.5 0 0 1 3 0V10m0-3a1.5 1.5 0 0 1 3 0v8M8 12l-2-2m2 9a6 6 0 0 0 4 2",
  frame: "M5 19V5m0 14h14M5 19l8-8m-8-6-2 2m2-2 2 2m10 10 2 2-2 2",
};
const CARDS = {
  face: ["Face", "stays with a person", "face"], ball: ["Ball", "the coloured one", "ball"], marker: ["Marker", "on the wall", "marker"],
  point: ["Point", "turn to it once", "point"], track: ["Track", "stay on a point", "track"], path: ["Path", "circle, square, eight", "path"],
  "follow a frame": ["Frame", "wherever it goes", "frame"], nothing: ["Hands off", "leave it alone", "nothing"],
  "fictitious target": ["Simulated", "the moving point", "point"], target_mux: ["Mux", "what target_mux selects", "track"], "what the camera finds": ["Camera", "what it finds", "face"],
};
const USUAL = ["face", "ball", "marker", "point", "path", "nothing"]; // the other cards are there where they are possible
export const titleOf = (mode) => CARDS[mode]?.[0] ?? mode;
const SHAPES = [["circle", "Circle"], ["square", "Square"], ["figure of eight", "Figure of eight"]];
const reach = ([low, high]) => Math.max(-low, high, 0.01);
const within = (value, [low, high]) => Math.min(Math.max(value, low), high);

export class Steering {
  constructor() {
    this.joints = {}; // of the pad and the sliders, not sent yet
    this.send = latestOnly((name, body) => {
      this.joints = {};
      return command(name, body);
    });
    this.makeOptions();
    this.makePad();
    by("centre").onclick = () => command("centre");
  }

  /** The edge of the pad is the joint limit that is farthest from 0. A positive pan looks left, a positive tilt down, unless its axis is reversed. */
  setRobot(robot) {
    const joint = (name, axis, sign) => {
      const found = robot.joints.find((one) => one.name === name);
      return found && { ...found, scale: (found.axis[axis] < 0 ? -sign : sign) * reach(found.limits) };
    };
    this.pan = joint(robot.pan, 2, -1);
    this.tilt = joint(robot.tilt, 1, 1);
  }

  makeOptions() {
    const form = by("options");
    form.onsubmit = (event) => { event.preventDefault(); this.go(); };
    const field = (name, text, make) => { const label = element(form, "label", { "data-for": name }); element(label, "span", {}, text); return make(label); };
    this.frame = field("frame", "Frame", (label) => element(label, "select", { id: "frame" }));
    this.shape = field("path", "Shape", (label) => element(label, "select", { id: "shape" }));
    this.xyz = ["x", "y", "z"].map((name, number) => field("point", `${name} (m)`, (label) => element(label, "input", { id: name, type: "number", step: 0.05, value: [1, 0, 0.5][number], required: "" })));
    offer(this.shape, SHAPES, "circle");
    this.size = field("path", "Half width (m)", (label) => element(label, "input", { id: "size", type: "number", min: 0.05, max: 2, step: 0.05, value: 0.3 }));
    this.speed = field("path", "Speed (m/s)", (label) => element(label, "input", { id: "speed-of-path", type: "number", min: 0.01, max: 3, step: 0.01, value: 0.2 }));
    this.submit = element(form, "button", { type: "submit", id: "go" }, "Point head");
    this.shape.onchange = () => this.shape.blur();
    this.frame.onchange = () => { this.frame.blur(); if (this.mode === "follow a frame") this.go(); };
  }

  /** Send the options of the mode. */
  async go() {
    const speed = Number(this.speed.value);
    if (this.mode === "follow a frame") await command("mode", { mode: this.mode, frame: this.frame.value });
    else if (this.mode !== "path") await command("look", { point: this.xyz.map((input) => Number(input.value)), frame: this.frame.value });
    else await command("path", { shape: this.shape.value, size: Number(this.size.value), speed });
  }

  choose(mode) {
    if (mode === "path") { this.mode = mode; return this.go(); }
    return command("mode", { mode, frame: this.frame.value });
  }

  show(state) {
    this.mode = state.mode;
    offer(this.frame, state.frames.map((name) => [name, name]), this.frame.value || (state.frames.includes("base_link") ? "base_link" : state.frames[0]));
    write(by("target"), ["point", "track"].includes(state.mode) ? state.target_text : "");
    const cards = Object.keys(CARDS).filter((mode) => USUAL.includes(mode) || state.modes.includes(mode) || mode === state.mode);
    rows(by("cards"), "button", cards, (card, mode) => {
      const [title, text, icon] = CARDS[mode];
      card.dataset.mode = mode;
      card.onclick = () => this.choose(mode);
      element(element(card, "svg", { viewBox: "0 0 24 24", "aria-hidden": "true" }), "path", { d: ICONS[icon] });
      element(card, "b", {}, title);
      element(card, "span", {}, text);
    }, (card, mode) => {
      card.setAttribute("aria-pressed", state.mode === mode);
      card.disabled = !state.modes.includes(mode);
    });
    if (this.inView !== state.mode) { // on a phone the cards are wider than the page
      this.inView = state.mode;
      const card = by("cards").querySelector("[aria-pressed=true]");
      by("cards").scrollLeft = card.offsetLeft + (card.offsetWidth - by("cards").clientWidth) / 2;
    }
    this.showOptions();
  }

  showOptions() {
    const { mode } = this;
    const wanted = { frame: ["point", "track", "follow a frame"].includes(mode), point: ["point", "track"].includes(mode), path: mode === "path" };
    for (const node of by("options").querySelectorAll("[data-for]")) node.hidden = !wanted[node.dataset.for];
    by("options").hidden = !Object.values(wanted).some(Boolean);
    for (const id of ["live", "cards"]) by(id).classList.toggle("options", !by("options").hidden);
    write(this.submit, mode === "path" ? "Look along it" : mode === "follow a frame" ? "Follow" : "Point head");
  }

  makePad() {
    const pad = by("pad");
    for (const r of [0.34, 0.67, 1]) element(pad, "circle", { r });
    for (const angle of [0, 90, 180, 270]) element(pad, "path", { d: "M-.06 -1.04 0 -1.1 .06 -1.04", transform: `rotate(${angle})` });
    this.padTarget = element(pad, "circle", { r: 0.16, class: "target" });
    this.padHead = element(pad, "circle", { r: 0.1, class: "head" });
    const steer = (event) => {
      if (!(event.buttons & 1)) return;
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(pad.getScreenCTM().inverse());
      this.aimAt(at.x, at.y);
    };
    pad.onpointerdown = (event) => { pad.setPointerCapture(event.pointerId); steer(event); };
    pad.onpointermove = steer;
    pad.onkeydown = (event) => {
      const step = { ArrowLeft: [-0.05, 0], ArrowRight: [0.05, 0], ArrowUp: [0, -0.05], ArrowDown: [0, 0.05] }[event.key];
      if (!step) return;
      event.preventDefault();
      this.aimAt(Number(this.padHead.getAttribute("cx")) + step[0], Number(this.padHead.getAttribute("cy")) + step[1]);
    };
  }

  /** Move the joints to a place of the pad. */
  aimAt(x, y) {
    const { pan, tilt } = this;
    if (pan) this.aim({ [pan.name]: within(x * pan.scale, pan.limits), [tilt.name]: within(y * tilt.scale, tilt.limits) });
  }

  /** Move joints [rad or m]; joints that wait to be sent go into the same command. */
  aim(joints) {
    this.joints = { ...this.joints, ...joints };
    return this.send("aim", { joints: this.joints });
  }

  showPad(pan, tilt, wanted) {
    if (!this.pan) return;
    const place = (node, x, y) => {
      const known = Number.isFinite(x) && Number.isFinite(y);
      node.style.display = known ? "" : "none";
      if (!known) return;
      node.setAttribute("cx", within(x / this.pan.scale, [-1, 1]));
      node.setAttribute("cy", within(y / this.tilt.scale, [-1, 1]));
    };
    place(this.padHead, pan, tilt);
    place(this.padTarget, wanted?.[0] ?? NaN, wanted?.[1] ?? NaN);
  }
}
