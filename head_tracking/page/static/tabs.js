// The tabs Joints, Tune, Health and Record.
import { button, by, command, degrees, element, get, hold, isHeld, latestOnly, offer, radians, rows, send, toast, write } from "./dom.js";

const REFRESH = 1000, STEP = 0.002, WIDE = 99; // ms, of a slider, ratio
const isSlide = (joint) => joint.type === "prismatic";
const shown = (joint, position) => (isSlide(joint) ? 1000 * position : degrees(position));
const meant = (joint, value) => (isSlide(joint) ? value / 1000 : radians(value));

export class Joints {
  /** @param {(joints: Object<string, number>) => void} aim receives joint positions [rad or m]. */
  constructor(aim) {
    this.aim = aim;
    by("middle").onclick = () => this.centre();
    by("torque-on").onclick = () => command("torque", { on: true });
    this.sliders = [];
    for (const kind of ["pointerdown", "keydown"]) by("sliders").addEventListener(kind, () => { this.isGivenUp = false; });
  }

  /** Move all joints to 0, or to the middle of limits that do not have it. */
  centre() {
    const movable = this.sliders.filter(({ slider }) => !slider.disabled);
    if (!movable.length) return toast("No joint can be moved from here. Is the head stopped, or torque off?");
    this.aim(Object.fromEntries(movable.map(({ joint: { name, limits: [low, high] } }) => [name, low <= 0 && high >= 0 ? 0 : (low + high) / 2])));
  }

  setRobot(robot) {
    by("sliders").replaceChildren();
    this.sliders = robot.independent.map((name, number) => {
      const joint = robot.joints.find((one) => one.name === name);
      const [low, high] = joint.limits.map((limit) => shown(joint, limit).toFixed(1));
      const row = element(by("sliders"), "div", { class: "slider" });
      element(row, "span", { id: `joint-${number}` }, name);
      const about = { "aria-labelledby": `joint-${number}`, min: low, max: high, step: 0.1 };
      const slider = element(row, "input", { type: "range", ...about });
      const field = element(row, "input", { type: "number", ...about });
      element(row, "span", {}, isSlide(joint) ? "mm" : "°");
      const move = (value) => { hold(slider); hold(field); this.aim({ [name]: meant(joint, value) }); };
      slider.oninput = () => { if (this.isGivenUp) return; field.value = slider.value; move(Number(slider.value)); };
      field.onchange = () => { if (field.value !== "") move(Number(field.value)); field.blur(); };
      return { joint, slider, field, number };
    });
  }

  /** Follow the robot, except sliders that the user has just moved. */
  follow(positions) {
    for (const { joint, slider, field, number } of this.sliders) {
      if (positions[number] == null) continue;
      const value = shown(joint, positions[number]).toFixed(1);
      for (const input of [slider, field]) if (input.value !== value && !isHeld(input)) input.value = value;
    }
  }

  /** End a drag; Firefox goes on with that of a disabled slider. */
  giveUp() { this.isGivenUp = true; }

  show(state) {
    for (const { joint, slider, field } of this.sliders) slider.disabled = field.disabled = state.can_resume || !state.movable.includes(joint.name);
    const relaxed = state.servos.filter((servo) => servo.torque === false).map((servo) => servo.joint);
    const hints = state.free ? ["No hardware: the page publishes the sliders as joint_states."] : state.servos.length ? [] : ["No servo bus has been found: the sliders only show the joints."];
    if (relaxed.length) hints.push(`Relaxed: ${relaxed.join(", ")}. Their sliders follow your hand.`);
    if (state.servos.some((servo) => servo.refuses)) hints.push("Enable torque to move joints from here.");
    write(by("hint"), hints.join(" "));
    rows(by("torques"), "label", state.servos, (label, { controller }) => {
      label.className = "switch";
      const box = element(label, "input", { type: "checkbox", "data-controller": controller });
      element(label, "span", {}, controller.replace(/_controller$/, ""));
      box.onchange = () => { hold(box); box.blur(); command("torque", { controller, on: box.checked }); };
    }, (label, { torque }) => {
      const box = label.firstChild;
      box.indeterminate = torque === null;
      if (torque !== null && !isHeld(box)) box.checked = torque;
    }, ({ controller }) => controller);
  }
}

export class Tuning {
  constructor() {
    this.inputs = new Map();
    this.refresh = latestOnly(() => this.load());
    by("reset").onclick = () => this.run("reset");
    setInterval(() => { if (!document.hidden && !(by("tune").hidden && by("health").hidden)) this.refresh(); }, REFRESH);
  }

  /** Send a command that sets parameters; return whether it was carried out. */
  async run(name, body) {
    const { done, text } = await command(name, body);
    if (done) toast(text, 3);
    this.refresh();
    return done;
  }

  async load() {
    const answer = await get("/head/parameters");
    if (!answer.parameters) return;
    this.showPresets(answer.presets, answer.preset);
    const keys = new Set();
    for (const one of answer.parameters) {
      const key = `${one.node}/${one.name}`;
      keys.add(key);
      const known = this.inputs.get(key) ?? this.add(key, one);
      known.about = one;
      known.show(one.value);
    }
    for (const [key, { row }] of this.inputs) if (!keys.has(key)) { row.remove(); this.inputs.delete(key); }
    for (const group of document.querySelectorAll("fieldset[data-node]")) group.hidden = !group.querySelector(".parameter");
    by("experts").hidden = !by("experts").querySelector(".parameter");
    by("learned").hidden = !by("learning").querySelector(".parameter");
  }

  showPresets(presets, chosen) {
    rows(by("presets"), "button", Object.entries(presets), (card, [name, values]) => {
      card.dataset.preset = name;
      card.onclick = () => this.run("preset", { name });
      element(card, "b", {}, name[0].toUpperCase() + name.slice(1));
      const number = (what, value) => (value ? `${Number(value.toPrecision(3))}${what.endsWith("acceleration") ? "°/s²" : "°/s"}` : "automatic");
      element(card, "span", {}, Object.entries(values).map(([what, value]) => `${what.replaceAll("_", " ")} ${number(what, value)}`).join(", "));
    }, (card, [name]) => card.setAttribute("aria-pressed", name === chosen));
  }

  group(one) {
    const parent = by(one.learning ? "learning" : one.expert ? "experts" : "parameters");
    const found = [...parent.querySelectorAll(":scope > fieldset")].find((group) => group.dataset.node === one.node);
    if (found) return found;
    const group = element(parent, "fieldset", { "data-node": one.node });
    element(group, "legend", {}, one.node.split("/").at(-1));
    return group;
  }

  add(key, one) {
    const row = element(this.group(one), "div", { class: "parameter", title: `${one.name}: ${one.hint}` });
    const id = `parameter-${key.replace(/[^a-z0-9]/gi, "-")}`;
    const isSwitch = typeof one.value === "boolean"; // its label is around it: a larger target
    element(row, isSwitch ? "span" : "label", isSwitch ? { id: `${id}-name` } : { for: id }, one.unit ? `${one.label} (${one.unit})` : one.label);
    const known = { row, about: one };
    const set = async (input, value) => {
      if (known.about.careful && !(await this.ask(`${one.label}: ${known.about.value} becomes ${value}. This value protects the servos.`))) return known.show(known.about.value, true);
      hold(input);
      if (!(await this.run("set", { node: one.node, name: one.name, value }))) known.show(known.about.value, true);
    };
    let input;
    if (isSwitch) {
      input = element(element(row, "label", { class: "switch" }), "input", { id, type: "checkbox", "aria-labelledby": `${id}-name` });
      input.onchange = () => set(input, input.checked);
    } else if (one.choices.length) {
      input = element(row, "select", { id });
      offer(input, one.choices.map((choice) => [choice, choice]), one.value);
      input.onchange = () => { input.blur(); set(input, input.value); };
    } else if (typeof one.value === "number") {
      input = element(row, "input", { id, type: "number", step: "any" });
      input.onchange = () => { if (input.value !== "") set(input, Number(input.value)); else known.show(known.about.value, true); input.blur(); };
      if (one.low !== null && one.high !== null) this.addSlider(row, known, input, set);
    } else {
      input = element(row, "input", { id, type: "text" });
      input.onchange = () => { set(input, input.value); input.blur(); };
    }
    input.setAttribute("aria-describedby", element(row, "small", { id: `${id}-hint` }, one.hint).id);
    known.show = (value, force = false) => {
      if (!force && isHeld(input)) return;
      if (input.type === "checkbox") input.checked = value;
      else input.value = typeof value === "number" ? Number(value.toPrecision(6)) : value;
      known.follow?.(value);
    };
    this.inputs.set(key, known);
    return known;
  }

  /** Add a slider beside a number, finer at its left end if the range is wide. One across 0 has a step that is 0. */
  addSlider(row, known, input, set) {
    const { low, high, whole, label, value: present } = known.about;
    const power = low >= 0 && high >= WIDE * (low || present) ? 4 : 1;
    const toValue = (share) => low + share ** power * (high - low);
    const toShare = (value) => (Math.max(0, value - low) / (high - low || 1)) ** (1 / power);
    const slider = element(row, "input", { type: "range", min: 0, max: 1, step: STEP, "aria-label": label });
    const value = () => { const found = toValue(Number(slider.value)), exact = low < 0 && Math.abs(found) < (STEP * (high - low)) / 2 ? 0 : found; return whole ? Math.round(exact) : Number(exact.toPrecision(3)); };
    slider.oninput = () => { hold(input); hold(slider); input.value = value(); };
    slider.onchange = () => { set(input, value()); slider.blur(); };
    known.follow = (current) => { if (!isHeld(slider)) slider.value = toShare(current); };
  }

  /** Ask for confirmation; return whether the user confirms. */
  ask(text, yes = "Set it") {
    write(by("sure-text"), text);
    write(by("sure-yes"), yes);
    by("sure").show();
    by("sure-no").focus();
    return new Promise((resolve) => {
      by("sure-yes").onclick = () => { resolve(true); by("sure").close(); };
      by("sure-no").onclick = () => by("sure").close();
      by("sure").onclose = () => resolve(false);
    });
  }
}

export class Calibration {
  /** @param {(text: string, yes: string) => Promise<boolean>} ask asks for confirmation. */
  constructor(ask) {
    by("calibrate").querySelector("form").onsubmit = async (event) => {
      event.preventDefault();
      by("calibrator").blur();
      if (await ask("The head will look around for up to 90 seconds. Can it move freely?", "Look around"))
        command("calibrate", { size: Number(by("marker-size").value) / 1000, topic: ["", "none"].includes(by("source").value) ? "" : by("source").value });
    };
  }

  show({ runs, text, rows: found }) {
    by("calibrator").disabled = runs;
    write(by("calibrating"), text);
    rows(by("calibrated"), "tr", found, (row, [name, change, deviation]) => {
      element(row, "th", { scope: "row" }, name);
      element(row, "td", {}, change);
      element(row, "td", {}, deviation);
    });
  }
}

/** Show in its card why a part can't be shown. */
export function showFailing(failing) {
  for (const card of document.querySelectorAll("[data-parts]")) {
    const parts = card.dataset.parts.split(" ").filter((part) => part in failing);
    const text = parts.map((part) => `${part} can't be shown: ${failing[part]}`).join("\n");
    let note = card.querySelector(":scope > .failing");
    if (!text) { note?.remove(); continue; }
    note ??= element(card, "p", { class: "failing", role: "alert" });
    write(note, text);
  }
}

export function showHealth(state) {
  by("alarm").hidden = !state.faults.length;
  rows(by("faults"), "li", state.faults.length ? state.faults : [null], (row, fault) => {
    if (!fault) return write(row, "No faults.");
    row.className = "error";
    element(row, "strong", {}, fault.text);
    element(row, "span", {}, fault.advice);
    if (fault.command && state.can_recover) button(row, "Clear faults", () => command(fault.command));
  }, undefined, (fault) => JSON.stringify([fault, state.can_recover]));
  rows(by("statuses"), "li", state.health, (row, { name }) => {
    const details = element(row, "details"), summary = element(details, "summary");
    for (const part of ["b", "strong", "span"]) element(summary, part);
    write(summary.children[1], name);
    element(details, "dl");
  }, (row, { level, message, values }) => {
    row.className = level;
    const [word, , text] = row.querySelector("summary").children;
    write(word, level);
    write(text, message);
    rows(row.querySelector("dl"), "div", Object.entries(values), (part, [name, value]) => { element(part, "dt", {}, name); element(part, "dd", {}, value); });
  }, ({ name }) => name);
  const tracker = state.health.filter(({ name }) => name === "head_tracker: target");
  const learned = tracker.flatMap(({ values }) => Object.entries(values)).filter(([name]) => name.includes(": "));
  rows(by("learned-values"), "tr", learned, (row, [name]) => { element(row, "th", { scope: "row" }, name); element(row, "td"); }, (row, [, value]) => write(row.lastChild, value.replace("^2", "²")), ([name]) => name);
  const lines = [...state.notices, ...state.warnings];
  rows(by("notices"), "li", lines.length ? lines : ["None."], (row, line) => write(row, line));
}

export class Recordings {
  /** @param {(opened: object) => void} replay receives an open recording. */
  constructor(replay) {
    this.replay = replay;
    by("recorder").onclick = async () => { by("recorder").blur(); const outcome = await command("record", { on: !this.runs }); if (outcome.done) toast(outcome.text); };
    by("upload").onchange = async () => {
      const [file] = by("upload").files;
      if (file) await this.open("/head/replay/upload", file, file.name);
      by("upload").value = "";
    };
  }

  async open(path, body, name) {
    toast("The recording is being read. This takes about half a minute per hour.", 60);
    const opened = await send(path, body);
    if (!opened.key) return;
    toast(opened.notice || `${name}: ${opened.duration.toFixed(1)} s`);
    this.replay(opened);
  }

  show(state) {
    if (this.runs !== state.recording) this.refresh(); // maybe by another browser
    this.runs = state.recording;
    write(by("recorder"), state.recording ? "End recording" : "Record everything");
    by("recorder").classList.toggle("on", state.recording);
    write(by("recording"), state.recorder);
  }

  async refresh() {
    const files = await get("/head/recordings");
    if (!Array.isArray(files)) return;
    by("recordings").replaceChildren();
    for (const { name, size } of files) {
      const row = element(by("recordings"), "li");
      element(row, "span", {}, `${name} · ${(size / 1e6).toFixed(1)} MB`);
      button(row, "Replay", () => this.open("/head/replay/open", { name }, name), { "aria-label": `Replay ${name}` });
      element(row, "a", { class: "button", href: `/head/recordings/${encodeURIComponent(name)}`, download: name, "aria-label": `Download ${name}` }, "Download");
    }
    if (!files.length) element(by("recordings"), "li", {}, "There are no recordings yet.");
  }
}
