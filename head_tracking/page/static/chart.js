// A strip chart of the last 30 seconds, drawn ten times a second while it is seen.
const SECONDS = 30, LATEST = 1, LEFT = 44, BOTTOM = 24, STEP = 0.07; // s, pixels

export class Chart {
  constructor(canvas) {
    this.canvas = canvas;
    this.points = [];
    this.due = 0;
  }

  clear() { this.points = []; }

  /** Add head values at a time [s], and wanted ones at the target's [degrees]; a target that stays has an old one. */
  add(stamp, targetStamp, values) {
    if (!Number.isFinite(stamp)) return;
    if (this.points.length && stamp < this.points.at(-1).stamp) this.points = [];
    if (this.points.length && stamp < this.points.at(-1).stamp + STEP) return;
    this.points.push({ stamp, seen: Math.min(stamp, Math.max(targetStamp, stamp - LATEST)), values });
    while (this.points[0].stamp < stamp - SECONDS) this.points.shift();
    if (performance.now() < this.due || !this.canvas.clientWidth) return;
    this.due = performance.now() + 100;
    this.draw(stamp);
  }

  draw(now) {
    const { canvas } = this, scale = Math.min(devicePixelRatio, 2);
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== width * scale) canvas.width = width * scale;
    if (canvas.height !== height * scale) canvas.height = height * scale;
    const pen = canvas.getContext("2d");
    pen.setTransform(scale, 0, 0, scale, 0, 0);
    pen.clearRect(0, 0, width, height);
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(name).trim();
    const largest = this.points.flatMap(({ values }) => values).filter(Number.isFinite).reduce((most, value) => Math.max(most, Math.abs(value)), 0);
    const step = [5, 10, 20, 30, 60, 90].find((one) => one >= largest) ?? 180;
    const x = (stamp) => LEFT + (width - LEFT - 16) * (1 - (now - stamp) / SECONDS);
    const y = (value) => (height - BOTTOM) / 2 - (value / (step * 1.15)) * ((height - BOTTOM) / 2 - 4);
    pen.font = `${style.getPropertyValue("--small")} Roboto, sans-serif`;
    pen.fillStyle = colour("--dim");
    pen.strokeStyle = colour("--line");
    pen.lineWidth = 1;
    for (const line of [step, 0, -step]) {
      pen.textAlign = "right";
      pen.fillText(`${line}°`, LEFT - 8, y(line) + 4);
      pen.beginPath();
      pen.moveTo(LEFT, y(line));
      pen.lineTo(width - 16, y(line));
      pen.stroke();
    }
    for (const [ago, text] of [[30, "−30 s"], [20, "−20 s"], [10, "−10 s"], [0, "now"]]) {
      pen.textAlign = ago === 30 ? "left" : ago ? "center" : "right";
      pen.fillText(text, x(now - ago), height - 8);
    }
    ["--blue", "--teal", "--blue", "--teal"].forEach((name, number) => {
      pen.strokeStyle = colour(name);
      pen.lineWidth = number < 2 ? 2 : 1.2;
      pen.setLineDash(number < 2 ? [] : [4, 4]);
      pen.beginPath();
      let down = false;
      for (const { stamp, seen, values } of this.points) {
        const value = values[number], at = number < 2 ? stamp : seen, isShown = Number.isFinite(value) && at >= now - SECONDS;
        if (isShown) pen[down ? "lineTo" : "moveTo"](x(at), y(value));
        down = isShown;
      }
      pen.stroke();
    });
    pen.setLineDash([]);
  }
}
