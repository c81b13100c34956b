// The page: the live websocket, STOP, and the places. Each part keeps what a person set to itself.
import { RobotScene } from "./scene.js";
import { Chart } from "./chart.js";
import { CameraPicture } from "./camera.js";

const CARDS = { face: ["Face", "the nearest person"], ball: ["Ball", "the coloured one"], marker: ["Marker", "on the wall"], point: ["Point", "where you click"], "fictitious target": ["Path", "simulated target"], nothing: ["Hands off", "leave it alone"] };
const SVG = "http://www.w3.org/2000/svg";
const by = (id) => document.getElementById(id);
const degrees = (radians) => (radians * 180) / Math.PI;

function element(parent, name, attributes = {}, text = "") {
  const made = parent.namespaceURI === SVG ? document.createElementNS(SVG, name) : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.textContent = text;
  return parent.appendChild(made);
}

/** Set a text only where it changes: screen readers announce each change. */
function write(node, text) { if (node.textContent !== text) node.textContent = text; }

function toast(text) {
  write(by("toast"), text);
  by("toast").hidden = !text;
  clearTimeout(toast.timer);
  toast.timer = setTimeout(() => { by("toast").hidden = true; }, 5000);
}

async function send(path, body = {}) {
  try {
    const answer = await fetch(path, { method: "POST", headers: { "X-Head-Tracking": "page" }, body: JSON.stringify(body) });
    const outcome = (answer.headers.get("Content-Type") ?? "").includes("json") ? await answer.json() : { done: false, text: await answer.text() };
    if (!outcome.done) toast(outcome.text);
    return outcome;
  } catch {
    toast("The page's server does not answer. Use the stop key of the terminal, or the power switch.");
    return { done: false };
  }
}
const command = (name, body) => send(`/head/do/${name}`, body);

class Page {
  constructor() {
    this.robot = null;
    this.state = null;
    this.scene = new RobotScene(by("scene"));
    this.chart = new Chart(by("lines"));
    this.camera = new CameraPicture((u, v, stamp) => command("look", { u, v, stamp }), (frame) => command("mode", { mode: "follow a frame", frame }));
    by("stop").onclick = () => this.stop();
    by("resume").onclick = () => send("/head/resume");
    addEventListener("keydown", (event) => { if (event.key === "Escape" && !document.querySelector("dialog[open], select:focus")) this.stop(); });
    for (const tab of document.querySelectorAll("[role=tab]")) tab.onclick = () => this.go(tab.dataset.place);
    this.makePad();
    this.connect();
  }

  async stop() { toast((await send("/head/stop")).text); }

  go(place) {
    for (const tab of document.querySelectorAll("[role=tab]")) tab.setAttribute("aria-selected", tab.dataset.place === place);
    for (const section of document.querySelectorAll("section[data-place]")) section.hidden = section.dataset.place !== place;
  }

  connect() {
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/head/live`);
    socket.binaryType = "arraybuffer";
    socket.onmessage = async ({ data }) => {
      if (typeof data !== "string") {
        await this.camera.show(data);
        this.scene.showPicture(this.camera.image);
        if (socket.readyState === WebSocket.OPEN) socket.send("got");
        return;
      }
      const said = JSON.parse(data);
      if (said.type === "robot") this.setRobot(said);
      else this.show(said);
    };
    socket.onclose = () => {
      by("pill").dataset.word = "disconnected";
      write(by("word"), "disconnected");
      write(by("why"), "the page's server does not answer; trying again");
      setTimeout(() => this.connect(), 1000);
    };
  }

  setRobot(robot) {
    this.robot = robot;
    write(by("name"), robot.name);
    document.title = robot.name;
    this.scene.setRobot(robot);
    by("sliders").replaceChildren();
    for (const [number, name] of robot.independent.entries()) {
      const label = element(by("sliders"), "label");
      element(label, "span", {}, name);
      const [low, high] = name === robot.pan ? robot.pan_limits : name === robot.tilt ? robot.tilt_limits : [-Math.PI, Math.PI];
      const slider = element(label, "input", { type: "range", min: low, max: high, step: 0.005 });
      element(label, "output");
      slider.oninput = () => this.aim({ [name]: Number(slider.value) });
      slider.dataset.joint = number;
    }
  }

  /** Send joint positions; while one is under way only the latest is kept. */
  async aim(joints) {
    const waiting = this.wanted;
    this.wanted = { ...waiting, ...joints };
    if (this.aiming) return;
    this.aiming = true;
    while (this.wanted) {
      const next = this.wanted;
      this.wanted = null;
      await command("aim", { joints: next });
    }
    this.aiming = false;
  }

  show(state) {
    this.state = state;
    const [pan, tilt] = this.angles();
    this.scene.show(state.joints ?? [], state.target);
    this.camera.mark(state.faces ?? [], state.mode);
    this.chart.add(state.stamp, [pan, tilt].map(degrees));
    this.showPad(pan, tilt);
    const off = state.error == null ? "" : `${degrees(state.error).toFixed(1)}° off`;
    const failing = Object.entries(state.failing ?? {}).map(([part, why]) => `${part} can't be shown: ${why}`);
    by("pill").dataset.word = state.word ?? "";
    write(by("word"), state.word ?? "");
    write(by("why"), [...failing, state.text, off].filter(Boolean).join(" · "));
    by("pill").title = by("why").textContent;
    by("resume").hidden = !state.can_resume;
    this.showAngles(pan, tilt);
    const slow = JSON.stringify([state.mode, state.modes, state.servos, state.health]);
    if (slow === this.slow) return;
    this.slow = slow;
    this.showCards(state);
    this.showServos(state.servos ?? []);
    this.showHealth(state.health ?? []);
  }

  angles() {
    const { robot, state } = this;
    return [robot?.pan, robot?.tilt].map((name) => state.joints?.[robot?.independent.indexOf(name)] ?? NaN);
  }

  showAngles(pan, tilt) {
    if (!by("angles").children.length) for (const name of ["pan", "tilt"]) { const part = element(by("angles"), "div"); element(part, "dt", {}, name); element(part, "dd"); }
    const values = by("angles").querySelectorAll("dd");
    [pan, tilt].forEach((angle, number) => write(values[number], Number.isFinite(angle) ? `${degrees(angle).toFixed(1)}°` : "–"));
    for (const slider of by("sliders").querySelectorAll("input")) {
      const position = this.state.joints?.[slider.dataset.joint];
      if (position == null) continue;
      write(slider.nextSibling, `${degrees(position).toFixed(1)}°`);
      if (document.activeElement !== slider) slider.value = position;
    }
  }

  showCards(state) {
    for (const [mode, [title, text]] of Object.entries(CARDS)) {
      let card = by("cards").querySelector(`[data-mode="${mode}"]`);
      if (!card) {
        card = element(by("cards"), "button", { "data-mode": mode });
        element(card, "b", {}, title);
        element(card, "span", {}, text);
        card.onclick = () => command("mode", { mode });
      }
      card.setAttribute("aria-pressed", state.mode === mode);
      card.disabled = !(state.modes ?? []).includes(mode);
    }
  }

  showServos(servos) {
    by("gauges").replaceChildren();
    for (const servo of servos) {
      const row = element(by("gauges"), "div", { class: "servo" });
      const name = element(row, "div");
      element(name, "div", {}, servo.joint || servo.controller);
      element(name, "small", {}, servo.torque === null ? "torque unknown" : servo.torque ? "torque on" : "relaxed");
      for (const [key, unit, full] of [["temperature", "°C", 80], ["voltage", "V", 16], ["load", "load %", 100]]) {
        const [, text] = Object.entries(servo.values).find(([about]) => about.startsWith(key)) ?? [];
        const value = Number.parseFloat(text);
        gauge(row, value, unit, full);
      }
    }
  }

  showHealth(health) {
    by("faults").replaceChildren();
    for (const one of health) {
      const row = element(by("faults"), "li", { class: one.level });
      element(row, "b", {}, one.level);
      element(row, "strong", {}, one.name);
      element(row, "span", {}, one.message);
    }
  }

  makePad() {
    const pad = by("pad");
    for (const radius of [0.34, 0.67, 1]) element(pad, "circle", { r: radius });
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

  /** Aim at a place of the pad: its edge is the joint limit that is farthest from 0. */
  aimAt(x, y) {
    const { robot } = this;
    if (!robot?.pan) return;
    const within = (value, [low, high]) => Math.min(Math.max(value, low), high);
    this.aim({ [robot.pan]: within(-x * reach(robot.pan_limits), robot.pan_limits), [robot.tilt]: within(y * reach(robot.tilt_limits) * this.down(), robot.tilt_limits) });
  }

  /** Return 1 where a positive tilt looks down, -1 where it looks up. */
  down() { return (this.robot.joints.find((joint) => joint.name === this.robot.tilt)?.axis[1] ?? 1) < 0 ? -1 : 1; }

  showPad(pan, tilt) {
    const { robot } = this;
    if (!robot?.pan || !Number.isFinite(pan) || !Number.isFinite(tilt)) return;
    this.padHead.setAttribute("cx", -pan / reach(robot.pan_limits));
    this.padHead.setAttribute("cy", (this.down() * tilt) / reach(robot.tilt_limits));
    const ray = this.scene.targetDirection();
    this.padTarget.style.display = ray ? "" : "none";
    if (ray) {
      this.padTarget.setAttribute("cx", Math.min(Math.max(-ray[0] / reach(robot.pan_limits), -1), 1));
      this.padTarget.setAttribute("cy", Math.min(Math.max(-ray[1] / reach(robot.tilt_limits), -1), 1));
    }
  }
}

const reach = ([low, high]) => Math.max(-low, high, 0.01);

function gauge(parent, value, unit, full) {
  const known = Number.isFinite(value);
  const svg = parent.appendChild(document.createElementNS(SVG, "svg"));
  svg.setAttribute("viewBox", "0 0 54 54");
  svg.setAttribute("class", "gauge");
  svg.setAttribute("role", "img");
  svg.setAttribute("aria-label", known ? `${value} ${unit}` : `${unit} unknown`);
  element(svg, "circle", { cx: 27, cy: 27, r: 24 });
  if (known) element(svg, "circle", { class: "value", cx: 27, cy: 27, r: 24, pathLength: 100, "stroke-dasharray": `${Math.min(100, (100 * Math.abs(value)) / full)} 100`, transform: "rotate(-90 27 27)" });
  element(svg, "text", { x: 27, y: 28 }, known ? String(Math.round(value * 10) / 10) : "–");
  element(svg, "text", { x: 27, y: 39 }, unit);
}

/** NiceGUI renders the page's HTML with Vue: wait for it. */
function start() { if (by("toast")) window.headPage = new Page(); else requestAnimationFrame(start); }
start();
