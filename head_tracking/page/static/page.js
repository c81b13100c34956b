// The page: the live websocket, STOP and the tabs.
import { CameraPicture } from "./camera.js";
import { Chart } from "./chart.js";
import { abort, by, command, degrees, element, guardSliders, kept, know, offer, refusalOf, rows, send, toast, write } from "./dom.js";
import { Calibration, Joints, Recordings, Tuning, showFailing, showHealth } from "./tabs.js";
import { Replay } from "./replay.js";
import { Steering, titleOf } from "./steer.js";

const SILENT = 3000, DEAD = 10000; // ms without a state until the page shows "disconnected", and connects again
const AGAIN = 1000, REPEATS = 60; // ms until a STOP that could not be sent is sent again, and how often
const STEPS = [
  ["This is your head", "The page shows its camera picture and the robot in 3D. Click into the picture, and the head looks there."],
  ["This is STOP: try it", "STOP, or the key Esc, relaxes all servos at once. Nothing moves again until you press Resume."],
  ["Let it follow you", "Choose Face, and the head follows a person. Hands off ends that."],
];

const GAUGES = [ // the value in the servo's diagnostics, unit, full scale, factor
  ["temperature (degrees Celsius)", "°C", 80, 1], ["voltage (V)", "V", 16, 1], ["load (share of full torque)", "load %", 100, 100],
];

class Page {
  constructor() {
    this.state = null;
    this.about = null;
    this.silent = ""; // why no states are received
    this.stops = 0; // another number ends the repeats of a STOP
    this.failing = {}; // why it can't show a part, by part
    by("stop").onclick = () => this.stop(); // first: STOP must not depend on what comes below
    addEventListener("keydown", (event) => this.onKey(event));
    guardSliders();
    this.chart = new Chart(by("lines"));
    this.steer = new Steering();
    this.camera = new CameraPicture(
      (u, v, stamp) => this.steer.send("look", { u, v, stamp, topic: by("source").value }),
      ({ select }) => command("select", select),
    );
    this.joints = new Joints((joints) => this.steer.aim(joints));
    this.tuning = new Tuning();
    this.calibration = new Calibration((text, yes) => this.tuning.ask(text, yes));
    this.replay = new Replay((state) => this.show(state), (blob) => this.showRecorded(blob), (robot) => this.setRobot(robot ?? this.robot, !robot));
    this.recordings = new Recordings((opened) => { this.replay.open(opened); this.openTab("live"); });
    by("resume").onclick = () => { this.stops += 1; by("resume").blur(); toast(""); send("/head/resume"); };
    by("source").onchange = () => { by("source").blur(); this.camera.clear(); this.chooseCamera(); };
    this.makeTabs();
    this.makeTheme();
    this.connect();
    this.addScene();
    setInterval(() => this.checkSilent(), 500);
    if (!kept("head-welcomed")) this.welcome(0);
  }

  /** Add the robot in 3D, last: on a slow computer it takes as long as all else. */
  async addScene() {
    try {
      const { RobotScene } = await import("./scene.js");
      this.scene = new RobotScene(by("scene"), (point) => this.steer.send("look", { point }));
      if (this.shownRobot) this.scene.setRobot(this.shownRobot);
    } catch (error) {
      this.failing.robot = `${error.message} All else works in a browser without WebGL.`;
      this.showFailing(this.about?.failing);
    }
  }

  /** Give up what was asked before a STOP: it does not happen after it. */
  giveUp() {
    by("sure").close();
    this.camera.release();
    this.steer.giveUp();
    this.joints.giveUp();
  }

  async stop() {
    this.giveUp();
    abort();
    const number = (this.stops += 1);
    for (let repeats = 0; repeats < REPEATS && number === this.stops; repeats += 1) {
      const { done, text } = await send("/head/stop", {}, "POST", SILENT);
      if (text) toast(text, done ? 4 : 12);
      if (done || text) return;
      await new Promise((go) => setTimeout(go, AGAIN)); // the page's process may just be started again
    }
  }

  /** Esc closes an open question or menu; else it is STOP, beside the welcome as well. */
  onKey(event) {
    if (event.key !== "Escape" || event.repeat) return;
    if (by("sure").open) { by("sure").close(); event.preventDefault(); return; }
    if (document.activeElement?.tagName === "SELECT") { document.activeElement.blur(); return; }
    this.stop();
  }

  makeTabs() {
    const tabs = [...document.querySelectorAll("[role=tab]")];
    for (const [number, tab] of tabs.entries()) {
      tab.onclick = () => this.openTab(tab.dataset.tab);
      tab.onkeydown = (event) => {
        const step = { ArrowDown: 1, ArrowRight: 1, ArrowUp: -1, ArrowLeft: -1 }[event.key];
        if (!step) return;
        event.preventDefault();
        const next = tabs[(number + step + tabs.length) % tabs.length];
        next.focus();
        this.openTab(next.dataset.tab);
      };
    }
  }

  openTab(name) {
    for (const tab of document.querySelectorAll("[role=tab]")) {
      tab.setAttribute("aria-selected", tab.dataset.tab === name);
      tab.tabIndex = tab.dataset.tab === name ? 0 : -1;
    }
    for (const section of document.querySelectorAll("section[data-tab]")) section.hidden = section.dataset.tab !== name;
    // on Tune the chart shows the effect of a change, on Joints the robot in 3D does
    for (const [card, other] of [["chart", "tune"], ["robot", "joints"]]) {
      const home = by(name === other ? other : "live");
      if (by(card).parentNode !== home) home.prepend(by(card));
    }
    document.querySelector("main").scrollTop = 0;
    if (name === "tune") this.tuning.refresh();
    if (name === "record") this.recordings.refresh();
    this.chooseCamera();
  }

  makeTheme() {
    const system = matchMedia("(prefers-color-scheme: dark)");
    const apply = () => { document.documentElement.dataset.theme = kept("head-theme") ?? (system.matches ? "dark" : "light"); };
    system.onchange = apply;
    by("theme").onclick = () => { kept("head-theme", document.documentElement.dataset.theme === "dark" ? "light" : "dark"); apply(); };
    apply();
  }

  welcome(step) {
    const end = () => {
      kept("head-welcomed", "1");
      by("welcome").close();
    };
    write(by("welcome-title"), `${step + 1}. ${STEPS[step][0]}`);
    write(by("welcome-text"), STEPS[step][1]);
    write(by("welcome-next"), step === STEPS.length - 1 ? "Begin" : "Next");
    by("welcome-next").onclick = () => (step === STEPS.length - 1 ? end() : this.welcome(step + 1));
    by("welcome-end").onclick = end;
    if (!by("welcome").open) by("welcome").show();
  }

  connect() {
    const socket = (this.socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/head/live`));
    socket.binaryType = "arraybuffer";
    socket.onopen = () => { this.heard = performance.now(); this.chooseCamera(); };
    socket.onmessage = async ({ data }) => {
      this.heard = performance.now();
      this.setSilent("");
      if (typeof data !== "string") return this.picture = this.showPicture(data);
      const message = JSON.parse(data);
      if (message.type === "robot") return this.setRobot((this.robot = message), true);
      if (message.type === "about") return this.showAbout(message);
      if (!this.replay.opened) this.show(message);
      await this.picture;
      if (!document.hidden) await new Promise((go) => setTimeout(go)); // to a click that waits; a hidden page would pause for long
      if (socket.readyState === WebSocket.OPEN) socket.send("got");
    };
    socket.onclose = async ({ code, reason }) => {
      const unknown = "the page's server does not answer; trying again";
      if (!this.silent) this.setSilent(unknown); // its reason may come late
      this.setSilent((code === 4008 ? reason : await refusalOf("/")) || unknown);
      setTimeout(() => this.connect(), 1000);
    };
  }

  async showPicture(data) {
    if (this.replay.opened || by("source").value === "none") return; // one may still arrive
    await this.camera.show(data);
    this.scene?.showPicture(this.camera.image);
  }

  async showRecorded(blob) {
    if (!blob) return this.camera.clear();
    await this.camera.showBlob(blob, "recorded");
    this.scene?.showPicture(this.camera.image);
  }

  /** Show that no states come, and open another connection after a while: a dead one does not close by itself. */
  checkSilent() {
    if (document.hidden) return;
    this.camera.checkAge();
    if (this.socket.readyState !== WebSocket.OPEN) return;
    const silence = performance.now() - this.heard;
    if (silence > SILENT) this.setSilent("no state has come for 3 s");
    if (silence < DEAD) return;
    Object.assign(this.socket, { onmessage: null, onclose: null }).close();
    this.connect();
  }

  /** Show why no states are received; only STOP can be used until then. Empty: they are received. */
  setSilent(why) {
    if (this.silent === why) return;
    this.silent = why;
    for (const name of ["live", "joints"]) by(name).inert = Boolean(why);
    this.showWord();
  }

  chooseCamera() {
    if (this.socket?.readyState !== WebSocket.OPEN) return;
    this.socket.send((by("live").hidden && by("joints").hidden) || by("source").value === "none" ? "blind" : `camera ${by("source").value}`);
  }

  setRobot(robot, isLive) {
    if (!robot || (this.replay.opened && isLive)) return;
    write(by("name"), robot.name);
    document.title = robot.name;
    this.shownRobot = robot;
    this.steer.setRobot(robot);
    this.chart.clear();
    this.attempt({ model: () => this.scene?.setRobot(robot), sliders: () => isLive && this.joints.setRobot(robot) });
  }

  /** Show parts of the page; one that fails says so in its card. */
  attempt(parts) {
    const before = JSON.stringify(this.failing);
    for (const [part, show] of Object.entries(parts)) {
      try { show(); delete this.failing[part]; } catch (error) { this.failing[part] = error.message; }
    }
    if (JSON.stringify(this.failing) !== before) this.showFailing(this.about?.failing);
  }

  showFailing(others) { showFailing({ ...others, ...this.failing }); }

  /** Show joints, target and boxes: they change 20 times a second. */
  show(state) {
    this.state = state;
    const names = this.shownRobot?.independent ?? [];
    const angle = (name) => state.joints?.[names.indexOf(name)] ?? NaN;
    const [pan, tilt] = [angle(this.shownRobot?.pan), angle(this.shownRobot?.tilt)];
    this.attempt({
      view: () => this.scene?.show(state.joints ?? [], state.target, state.stamp, state.target_stamp ?? state.stamp),
      marks: () => this.camera.mark(["", state.boxes_of].includes(by("source").value) ? state.boxes ?? [] : []), // they belong to one camera
      chart: () => this.chart.add(state.stamp, state.target_stamp ?? state.stamp, [pan, tilt, ...(state.wanted ?? []).map((value) => value ?? NaN)].map(degrees)),
      pad: () => this.steer.showPad(pan, tilt, state.wanted),
      sliders: () => !this.replay.opened && this.joints.follow(state.joints ?? []),
    });
    for (const [id, value] of [["pan", pan], ["tilt", tilt]]) write(by(id), Number.isFinite(value) ? `${degrees(value).toFixed(1)}°` : "–");
    this.showWord();
  }

  /** Show the status of the head, live or recorded. */
  showWord() {
    const { word, text: why } = this.silent ? { word: "disconnected", text: this.silent } : this.state?.word ? this.state : this.live();
    if (!word) return; // no state has been received
    by("pill").dataset.word = word;
    write(by("word"), word);
    write(by("why"), why);
    by("pill").title = why;
  }

  live() {
    const { word, text, stop, mode, error } = this.about ?? {};
    const off = error == null || ["stopped", "refused"].includes(word) ? "" : `${degrees(error).toFixed(1)}° off`;
    return { word, text: [text || (word === "on target" ? titleOf(mode) : ""), stop, off].filter(Boolean).join(" · ") };
  }

  /** Show modes, servos and health: they change four times a second at most. */
  showAbout(about) {
    know(about.stops);
    if (!about.word) { // the server could not sample the state: an older one must not be shown
      this.about = { word: "fault", text: "the state of the robot can't be shown" };
      this.showFailing(about.failing);
      return this.showWord();
    }
    if (about.stops !== this.about?.stops) this.giveUp(); // somebody has pressed STOP
    this.about = about;
    if (!about.can_resume && !by("resume").hidden) toast(""); // somebody has resumed
    by("resume").hidden = !about.can_resume;
    write(by("nopicture").firstElementChild, about.has_camera ? "No picture" : "No camera publishes images");
    offer(by("source"), [["", "camera"], ...about.images.map((topic) => [topic, topic]), ["none", "no picture"]]);
    this.attempt({
      modes: () => this.steer.show(about),
      torques: () => this.joints.show(about),
      recordings: () => this.recordings.show(about),
      servos: () => showServos(about.servos),
      health: () => showHealth(about),
      calibration: () => this.calibration.show(about.calibration),
    });
    this.showFailing(about.failing);
  }
}

function showServos(servos) {
  const models = servos.map(({ values }) => values.model).filter(Boolean);
  if (models.length) write(by("about"), [...new Set(models)].map((model) => `${model} × ${models.filter((one) => one === model).length}`).join(", "));
  rows(by("gauges"), "div", servos, (row, servo) => {
    row.className = "servo";
    const name = element(row, "div");
    element(name, "div", { title: servo.joint }, (servo.joint || servo.controller).replace(/_(joint|controller)$/, "").replaceAll("_", " "));
    element(name, "small", { class: servo.torque ? "torque holds" : "torque" }, servo.torque === null ? "torque unknown" : servo.torque ? "torque on" : "relaxed");
    for (const [key, unit, full, scale] of GAUGES) gauge(row, Math.abs(scale * Number.parseFloat(servo.values[key])), unit, full);
  });
}

function gauge(parent, value, unit, full) {
  const known = Number.isFinite(value);
  const ring = element(parent, "div", { class: "gauge", role: "img", "aria-label": known ? `${value.toFixed(1)} ${unit}` : `${unit} unknown` });
  ring.style.setProperty("--share", known ? `${Math.min(100, (100 * value) / full)}%` : "0%");
  const inside = element(ring, "div");
  element(inside, "b", {}, known ? String(Math.round(value * 10) / 10) : "–");
  element(inside, "small", {}, unit);
}

window.headPage = new Page();
