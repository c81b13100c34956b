// The replay of a recording in this browser; other browsers still show the robot.
import { by, element, get, latestOnly, offer, refuse, write } from "./dom.js";

const PERIOD = 66, MOST_MARKS = 200; // ms

export class Replay {
  /** The functions receive a recorded state, picture (null: none) and robot (null: the live one again). */
  constructor(show, showPicture, change) {
    Object.assign(this, { show, showPicture, change, opened: null, speed: 1 });
    this.load = latestOnly(() => this.request());
    by("play").onclick = () => this.play(!this.playing);
    by("back").onclick = () => this.close();
    by("time").oninput = () => { this.play(false); this.go(Number(by("time").value)); };
    by("speed").onchange = () => { this.speed = Number(by("speed").value); by("speed").blur(); };
    by("moments").onchange = () => { if (by("moments").value) this.go(Number(by("moments").value)); by("moments").blur(); };
  }

  open(opened) {
    this.opened = opened;
    refuse("A recording is shown in this browser: press Back to the robot first.");
    this.at = 0;
    by("replaying").hidden = false;
    by("time").max = opened.duration;
    offer(by("moments"), [["", opened.moments.length ? "Go to ..." : "No marks"], ...opened.moments.map(({ time, text }) => [String(time), `${time.toFixed(1)} s: ${text}`])], "");
    by("marks").replaceChildren();
    for (const { time, text } of opened.moments.slice(0, MOST_MARKS)) element(by("marks"), "i", { title: text, style: `left:${(100 * time) / (opened.duration || 1)}%` });
    this.change(opened.robot);
    this.play(false);
    this.go(0);
  }

  close() {
    this.play(false);
    this.opened = null;
    refuse("");
    by("replaying").hidden = true;
    this.change(null);
  }

  play(on) {
    this.playing = on;
    write(by("play"), on ? "Pause" : "Play");
    clearInterval(this.timer);
    if (!on) return;
    if (this.at >= this.opened.duration) this.at = 0;
    let before = performance.now();
    this.timer = setInterval(() => {
      const now = performance.now();
      const next = Math.min(this.at + (this.speed * (now - before)) / 1000, this.opened.duration);
      before = now;
      this.go(next);
      if (next >= this.opened.duration) this.play(false);
    }, PERIOD);
  }

  /** Show a time of the recording [s]. */
  go(time) {
    this.at = time;
    by("time").value = time;
    write(by("clock"), `${time.toFixed(1)} / ${this.opened.duration.toFixed(1)} s`);
    this.load();
  }

  async request() {
    const { opened, at } = this;
    if (!opened) return;
    const address = `/head/replay/${opened.key}`;
    const picture = opened.pictures ? fetch(`${address}/picture?time=${at}`).catch(() => null) : null;
    const [state, answer] = await Promise.all([get(`${address}/at?time=${at}`), picture]);
    if (this.opened !== opened || state.done === false) return;
    this.show(state);
    this.showPicture(answer?.status === 200 ? await answer.blob() : null);
  }
}
