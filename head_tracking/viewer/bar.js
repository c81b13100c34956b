// What lies above viser's page, in view on every tab, whatever is folded away or scrolled: STOP and
// the badge, the camera's picture, the legend, the theme.
"use strict";
(() => {
  const PERIOD = 400, SILENT = 3000, PICTURE = 100; // ms
  const PHONE = "(max-width: 576px)"; // viser's own
  const OPEN = "[role=dialog], [role=listbox], [aria-haspopup][aria-expanded=true]";
  const COLOURS = {
    "on target": "#2b8a3e", moving: "#1971c2", holding: "#495057", relaxed: "#5f3dc4",
    stopped: "#c92a2a", refused: "#d9480f", replay: "#862e9c", fault: "#c92a2a",
    disconnected: "#212529",
  };
  const STYLE = `
    :root { --head-paper: #ffffffe8; --head-ink: #343a40; }
    :root[data-head-theme=dark] { --head-paper: #25262be8; --head-ink: #ced4da; color-scheme: dark; }
    :root[data-head-theme=dark] canvas[data-engine] { background: #2c2f36; }
    #head-bar { position: fixed; top: 8px; left: 8px; z-index: 10000; display: flex; gap: 8px;
      align-items: stretch; max-width: calc(100vw - 16px); font: 14px/1.25 system-ui, sans-serif;
      pointer-events: none; }
    #head-bar > * { pointer-events: auto; }
    #head-bar button { min-height: 52px; border: 0; border-radius: 8px; color: #fff; cursor: pointer;
      font: inherit; font-weight: 700; box-shadow: 0 1px 5px #0006; flex: none; }
    #head-bar button:focus-visible { outline: 3px solid #ffd43b; }
    #head-stop { background: #e03131; font-size: 20px !important; letter-spacing: 1px;
      padding: 0 22px; }
    #head-stop:active { background: #a51111; }
    #head-resume { background: #1971c2; padding: 0 14px; }
    #head-bar [hidden], #head-eye[hidden], #head-veil[hidden] { display: none; }
    #head-badge { border-radius: 8px; color: #fff; padding: 6px 12px; min-width: 96px;
      max-width: min(340px, 46vw); box-shadow: 0 1px 5px #0006; overflow-wrap: anywhere; }
    #head-badge b { display: block; text-transform: uppercase; letter-spacing: .5px; }
    #head-badge span { display: block; font-size: 12px; max-height: 62px; overflow: hidden; }
    #head-veil { position: fixed; inset: 0; z-index: 9000; background: #8889; cursor: not-allowed; }
    #head-corner { position: fixed; right: calc(var(--head-right, 0px) + 8px); bottom: 8px; z-index: 20;
      display: flex; flex-direction: column-reverse; gap: 6px; align-items: flex-end; font: 12px/1.4 system-ui, sans-serif; color: var(--head-ink);
      pointer-events: none; }
    #head-eye { position: relative; border-radius: 8px; overflow: hidden; box-shadow: 0 1px 5px #0006;
      width: clamp(150px, 24vw, 360px); background: #0008; pointer-events: auto; }
    #head-eye img { display: block; width: 100%; cursor: crosshair; touch-action: none;
      user-select: none; -webkit-user-drag: none; }
    #head-eye.folded { width: auto; } #head-eye.folded img { display: none; }
    #head-fold { position: absolute; top: 4px; right: 4px; border: 0; border-radius: 6px; color: #fff;
      background: #0009; font: inherit; padding: 3px 8px; cursor: pointer; }
    #head-eye.folded #head-fold { position: static; padding: 8px 10px; }
    #head-spot { position: absolute; width: 22px; height: 22px; margin: -11px; border-radius: 50%;
      border: 2px solid #e64bc8; box-shadow: 0 0 0 1px #fff8; pointer-events: none; }
    #head-said { position: absolute; inset: auto 0 0 0; padding: 3px 8px; background: #c92a2ae8;
      color: #fff; } #head-said:empty { display: none; }
    #head-legend { background: var(--head-paper); border-radius: 8px; padding: 5px 10px; }
    #head-legend:empty { display: none; }
    #head-legend i { display: inline-block; width: 18px; height: 4px; border-radius: 2px;
      margin-right: 7px; vertical-align: middle; }
    #head-theme { position: fixed; left: 8px; bottom: 8px; z-index: 20; height: 34px; width: 34px; border: 0;
      border-radius: 8px; background: var(--head-paper); color: var(--head-ink); cursor: pointer;
      font-size: 18px; box-shadow: 0 1px 5px #0006; }
    .uplot:not(:hover) .u-value, .u-legend .u-series:first-child { display: none !important; }
    .uplot:not(:hover) .u-legend th::after { content: none !important; }
    .mantine-Notifications-root { top: auto !important; bottom: 50px !important; }
    @media (max-width: 800px) {
      #head-badge span { max-height: 31px; } }
    @media ${PHONE} {
      :root { --head-scene: 46%; }
      :root:has(.mantine-Paper-root[style*="width: 20em"] [style*="width: 20em"] > [inert]) {
        --head-scene: calc(100% - 3.5em); }
      #root { height: var(--head-scene) !important; }
      #head-bar { right: 8px; } #head-badge { flex: 1; max-width: none; min-width: 0; }
      #head-corner, #head-theme { bottom: calc(100% - var(--head-scene) + 6px); }
      #head-corner { gap: 4px; line-height: 1.25; font-size: 11px; }
      #head-eye { width: 40vw; } #head-legend { padding: 3px 8px; }
      .mantine-Paper-root[style*="width: 20em"] { width: 100% !important; max-height: none !important;
        height: calc(100% - var(--head-scene)) !important; }
      .mantine-Notifications-root { top: 72px !important; bottom: auto !important; }
      .mantine-Paper-root [style*="width: 20em"] { width: 100% !important; } }`;
  let heard = performance.now(), beat = heard, told = "", toldUntil = 0;

  // viser takes its theme from the address, before it draws for the first time
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const choice = () => { try { return localStorage.getItem("head-theme"); } catch { return null; } };
  const wanted = () => choice() ?? (dark.matches ? "dark" : "light");
  const theme = wanted(), address = new URL(location.href);
  document.documentElement.dataset.headTheme = theme;
  if (theme === "dark") address.searchParams.set("darkMode", "");
  else address.searchParams.delete("darkMode");
  if (address.href !== location.href) history.replaceState(null, "", address);
  dark.addEventListener("change", () => { if (wanted() !== theme) location.reload(); });

  const make = (tag, id, text, parent) => {
    const node = document.createElement(tag);
    node.id = id;
    node.textContent = text;
    parent.append(node);
    return node;
  };
  const fetched = async (what) => {
    const answer = await fetch(`head/${what}`, {
      headers: { "X-Head-Tracking": "page" }, cache: "no-store", signal: AbortSignal.timeout(5000),
    });
    if (!answer.ok) throw new Error(await answer.text());
    return answer;
  };
  const ask = async (what) => (await fetched(what)).json();

  // a browser that was busy, asleep or hidden has not been listening: that is nobody's silence
  setInterval(() => {
    const now = performance.now();
    if (now - beat > 1000) heard += now - beat;
    beat = now;
  }, 250);

  const build = () => {
    make("style", "head-style", STYLE, document.head);
    const veil = make("div", "head-veil", "", document.body);
    veil.hidden = true;
    const bar = make("div", "head-bar", "", document.body);
    const stop = make("button", "head-stop", "STOP", bar);
    stop.title = "Relaxes all servos at once (Esc, while no menu or question is open)";
    const resume = make("button", "head-resume", "Resume", bar);
    resume.title = "Commands are taken again; the head moves slowly until it has arrived once";
    resume.hidden = true;
    const badge = make("div", "head-badge", "", bar);
    badge.setAttribute("role", "status");
    const word = make("b", "head-word", "", badge), text = make("span", "head-text", "", badge);
    const lamp = make("button", "head-theme", theme === "dark" ? "☀" : "☾", document.body);
    lamp.title = `Show the page ${theme === "dark" ? "light" : "dark"}`;
    lamp.onclick = () => {
      const other = theme === "dark" ? "light" : "dark";
      try {
        // what the browser wants anyhow is followed, also when that changes
        if (other === (dark.matches ? "dark" : "light")) localStorage.removeItem("head-theme");
        else localStorage.setItem("head-theme", other);
      } catch { /* then it stays as the browser wants it */ }
      location.reload();
    };

    const show = (what, why) => {
      word.textContent = what;
      text.textContent = why;
      badge.title = why;
      badge.dataset.word = what;
      badge.style.background = COLOURS[what] || "#495057";
    };
    const say = (answer) => { told = answer.text; toldUntil = performance.now() + 6000; };
    const press = (what) => async () => {
      told = `${what} ...`;
      toldUntil = performance.now() + 6000;
      try {
        say(await ask(what));
      } catch (error) {
        say({ text: `${what}: NOT confirmed, the viewer does not answer (${error.message})` });
      }
      look();
    };
    stop.onclick = press("stop");
    resume.onclick = press("resume");
    // before anything on the page gets the key; what is open is closed by it, and nothing else
    const open = () => [...document.querySelectorAll(OPEN)].some((one) => one.checkVisibility?.() ?? true);
    window.addEventListener("keydown", (event) => {
      if (event.key === "Escape" && !event.repeat && !open()) stop.click();
    }, true);
    // a button that was clicked would keep the focus, and the next Space would press it again
    bar.onmousedown = (event) => event.preventDefault();

    // an emptied number field shows what counts again: the value that it had
    document.addEventListener("focusin", ({ target }) => {
      if (target.matches?.("input[inputmode]")) target.dataset.headBefore = target.value;
    });
    document.addEventListener("focusout", ({ target }) => {
      const before = target.dataset?.headBefore;
      if (!before || target.value.trim() !== "") return;
      Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set.call(target, before);
      target.dispatchEvent(new Event("input", { bubbles: true }));
    });

    const corner = make("div", "head-corner", "", document.body);
    const showPicture = cameraPicture(corner);
    const legend = make("div", "head-legend", "", corner);
    let drawn = "";
    const showLegend = (meanings) => {
      if (drawn === (drawn = JSON.stringify(meanings))) return;
      legend.replaceChildren(...meanings.map(([meaning, colour]) => {
        const line = document.createElement("div"), swatch = document.createElement("i");
        swatch.style.background = colour;
        line.append(swatch, meaning);
        return line;
      }));
    };

    const look = async () => {
      try {
        const status = await ask(document.hidden ? "status" : "status?looks");
        heard = performance.now();
        document.title = status.title;
        resume.hidden = !status.can_resume;
        showPicture(status.picture);
        showLegend(status.legend);
        const stopped = status.stop && !["moving", "on target"].includes(status.word);
        show(status.word, [stopped ? status.stop : "", performance.now() < toldUntil && told !== status.stop
          ? told : "", status.text].filter(Boolean).join("; "));
      } catch (error) {
        if (performance.now() - heard > SILENT)
          show("disconnected", `the viewer does not answer; what is shown is ${
            Math.round((performance.now() - heard) / 1000)} s old. Is it still running?`);
      }
      veil.hidden = performance.now() - heard <= SILENT;
    };
    const again = async () => {
      await look();
      setTimeout(again, document.hidden ? 5 * PERIOD : PERIOD);
    };
    again();
    followScene();
  };

  // The camera's picture in the corner. Each is asked for when the one before is there, so that
  // a slow browser gets fewer; a hidden one gets none.
  const cameraPicture = (corner) => {
    const eye = make("div", "head-eye", "", corner), image = make("img", "head-image", "", eye);
    eye.hidden = true;
    image.alt = "what the camera sees";
    image.title = "Click or drag: the head looks there";
    const fold = make("button", "head-fold", "", eye), said = make("div", "head-said", "", eye);
    const folded = (so) => {
      eye.classList.toggle("folded", so);
      fold.textContent = so ? "camera" : "–";
      fold.title = so ? "Show the camera's picture" : "Fold the camera's picture away";
    };
    folded(false);
    fold.onclick = () => folded(!eye.classList.contains("folded"));
    let topic = "", number = "", stamp = "0", spot = null, silence = 0, asked = 0;

    const showNewest = async () => {
      if (!topic || document.hidden || eye.classList.contains("folded")) return;
      const took = Math.round(performance.now() - asked);
      asked = performance.now();
      const answer = await fetched(`picture?after=${number}&took=${took}`);
      if (answer.status !== 200) return;
      const data = await answer.blob(), wanted = topic;
      if (!wanted) return;
      const address = URL.createObjectURL(data), before = image.src;
      image.src = address;
      await image.decode();
      [number, stamp] = ["X-Number", "X-Stamp"].map((name) => answer.headers.get(name));
      if (before) URL.revokeObjectURL(before);
      eye.hidden = topic !== wanted;
    };
    const again = async () => {
      try { await showNewest(); } catch { /* the badge says it */ }
      setTimeout(again, PICTURE);
    };
    again();

    const place = (event) => {
      const { left, top, width, height } = image.getBoundingClientRect();
      const share = [(event.clientX - left) / width, (event.clientY - top) / height];
      return share.map((one) => Math.min(Math.max(one, 0), 1));
    };
    const mark = (u, v) => {
      const node = document.getElementById("head-spot") ?? make("div", "head-spot", "", eye);
      node.style.left = `${100 * u}%`;
      node.style.top = `${100 * v}%`;
    };
    const send = async () => {
      while (spot) {
        const [u, v] = spot;
        try {
          const answer = await ask(`look?u=${u}&v=${v}&stamp=${stamp}`);
          said.textContent = answer.done ? "" : answer.text;
        } catch (error) {
          said.textContent = `not sent: ${error.message}`;
        }
        if (!held) break;
        await new Promise((done) => setTimeout(done, PICTURE));
      }
      document.getElementById("head-spot")?.remove();
      clearTimeout(silence);
      silence = setTimeout(() => { said.textContent = ""; }, 6000);
      sending = false;
    };
    let held = false, sending = false;
    image.onpointerdown = (event) => {
      if (event.button) return;
      event.preventDefault();
      image.setPointerCapture(event.pointerId);
      held = true;
      mark(...spot = place(event));
      if (!sending) { sending = true; send(); }
    };
    image.onpointermove = (event) => { if (held) mark(...spot = place(event)); };
    image.onpointerup = image.onpointercancel = () => { held = false; };

    return (now) => {
      if (now === topic) return;
      topic = now;
      number = "";
      if (topic) return;
      eye.hidden = true;
      URL.revokeObjectURL(image.src);
      image.removeAttribute("src");
    };
  };

  // the corner is that of the scene: how much of the window is left of it is up to viser's panel
  const followScene = () => setInterval(() => {
    const scene = document.querySelector("canvas[data-engine]")?.getBoundingClientRect();
    if (scene) document.documentElement.style.setProperty("--head-right", `${innerWidth - scene.right}px`);
  }, 300);
  if (document.body) build(); else addEventListener("DOMContentLoaded", build);
})();
