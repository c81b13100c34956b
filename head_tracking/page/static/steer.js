// Mode cards with their options, and the pad for pan and tilt.
import { by, command, element, latestOnly, offer, rows, write } from "./dom.js";

const ICONS = {
  face: "M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18Zm-3 7v1m6-1v1m-6.5 4a5 5 0 0 0 7 0", ball: "M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18Zm0 0v18M3 12h18M6 5.5c4 3.5 4 9.5 0 13m12-13c-4 3.5-4 9.5 0 13",
  marker: "M4 4h6v6H4zm10 0h6v6h-6zM4 14h6v6H4zm10 0h2v2h-2zm4 4h2v2h-2z", point: "M12 2v4m0 12v4M2 12h4m12 0h4m-10-5a5 5 0 1 0 0 10 5 5 0 0 0 0-10Z",
  track: "M12 2v4m0 12v4M2 12h4m12 0h4m-10-1a1 1 0 1 0 0 2 1 1 0 0 0 0-2Z", path: "M7 8c-6 0-6 8 0 8 5 0 5-8 10-8 6 0 6 8 0 8-5 0-5-8-10-8Z", nothing: "M4 4l16 16M8 11V6a1.5 1.5 0 0 1 3 0m0 2V4.5a1.5 1.5 0 0 1 3 0V10m0-3a1.5 1.5 0 0 1 3 0v8M8 12l-2-2m2 9a6 6 0 0 0 4 2",
  frame: "M5 19V5m0 14h14M5 19l8-8m-8-6-2 2m2-2 2 2m10 10 2 2-2 2", simulated: "M19 6.5A9 9 0 1 1 12 3m5-1a2.5 2.5 0 1 0 0 5 2.5 2.5 0 0 0 0-5Z",
  mux: "M3 6h5l5 6h8M3 18h5l5-6m5-3 3 3-3 3", camera: "M3 7h12v10H3zM15 11l6-3.5v9L15 13",
};
export const CARDS = {
  face: ["Face", "stays with a person", "face"], ball: ["Ball", "the coloured one", "ball"], marker: ["Marker", "on the wall", "marker"],
  point: ["Point", "turn to it once", "point"], track: ["Track", "stay on a point", "track"], path: ["Path", "circle, square, eight", "path"],
  "follow a frame": ["Frame", "wherever it goes", "frame"], nothing: ["Hands off", "leave it alone", "nothing"],
  "fictitious target": ["Simulated", "the moving point", "simulated"], target_mux: ["Mux", "what target_mux selects", "mux"], "what the camera finds": ["Camera", "what it finds", "camera"],
};
const USUAL = ["face", "ball", "marker", "point", "path", "nothing"]; // the other cards are there where they are possible
export const titleOf = (mode) => CARDS[mode]?.[0] ?? mode;
const reach = ([low, high]) => Math.max(-low, high, 0.01);
const within = (value, [low, high]) => Math.min(Math.max(value, low), high);

export class Steering {
  constructor() {
    this.joints = {}; // of the pad and the sliders, not sent yet
    this.send = latestOnly((name, body) => {
      this.joints = {};
      return command(name, body);
    });
    this.listenToPad();
    by("centre").onclick = () => command("centre");
    by("options").onsubmit = (event) => { event.preventDefault(); this.go(); };
    by("shape").onchange = () => by("shape").blur();
    by("frame").onchange = () => { by("frame").blur(); if (this.mode === "follow a frame") this.go(); };
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

  /** Send the options of the mode. */
  go() {
    const frame = by("frame").value, number = (id) => Number(by(id).value);
    if (this.mode === "follow a frame") return command("mode", { mode: this.mode, frame });
    if (this.mode !== "path") return command("look", { point: ["x", "y", "z"].map(number), frame });
    return command("path", { shape: by("shape").value, size: number("size"), speed: number("speed-of-path") });
  }

  choose(mode) {
    if (mode === "path") { this.mode = mode; return this.go(); }
    return command("mode", { mode }); // the frame to follow is chosen after that
  }

  show(state) {
    this.mode = state.mode;
    offer(by("frame"), state.frames.map((name) => [name, name]), by("frame").value || (state.frames.includes("base_link") ? "base_link" : state.frames[0]));
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
    if (this.inView !== state.mode && by("cards").clientWidth) { // on a phone the cards are wider than the page
      this.inView = state.mode;
      const card = by("cards").querySelector("[aria-pressed=true]");
      by("cards").scrollLeft = card.offsetLeft + (card.offsetWidth - by("cards").clientWidth) / 2;
    }
    this.showOptions();
  }

  showOptions() {
    const { mode } = this;
    const wanted = { frame: ["point", "track", "follow a frame"].includes(mode), point: ["point", "track"].includes(mode), path: mode === "path" };
    for (const label of by("options").querySelectorAll("label")) label.hidden = label.control.disabled = !wanted[label.dataset.for]; // hidden ones are not validated
    by("options").hidden = !Object.values(wanted).some(Boolean);
    for (const id of ["live", "cards"]) by(id).classList.toggle("options", !by("options").hidden);
    write(by("go"), mode === "path" ? "Look along it" : mode === "follow a frame" ? "Follow" : "Point head");
  }

  listenToPad() {
    const pad = by("pad");
    this.padTarget = pad.querySelector(".target");
    this.padHead = pad.querySelector(".head");
    const steer = (event) => {
      if (!this.pressed) return;
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(pad.getScreenCTM().inverse());
      this.aimAt(at.x, at.y);
    };
    pad.onpointerdown = (event) => { this.pressed = !event.button; pad.setPointerCapture(event.pointerId); steer(event); };
    pad.onpointermove = steer;
    pad.onpointerup = pad.onpointercancel = () => { this.pressed = false; };
    pad.onkeydown = (event) => {
      const step = { ArrowLeft: [-0.05, 0], ArrowRight: [0.05, 0], ArrowUp: [0, -0.05], ArrowDown: [0, 0.05] }[event.key];
      if (!step) return;
      event.preventDefault();
      this.aimAt(Number(this.padHead.getAttribute("cx")) + step[0], Number(this.padHead.getAttribute("cy")) + step[1]);
    };
  }

  /** End a drag, and do not send what waits. */
  giveUp() {
    this.pressed = false;
    this.joints = {};
    this.send.giveUp();
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
