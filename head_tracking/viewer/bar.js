// STOP and the badge, above viser's page: in view on every tab, whatever is folded away or scrolled.
"use strict";
(() => {
  const PERIOD = 400, SILENT = 3000; // ms
  const COLOURS = {
    "on target": "#2b8a3e", moving: "#1971c2", holding: "#495057", relaxed: "#5f3dc4",
    stopped: "#c92a2a", refused: "#d9480f", replay: "#862e9c", fault: "#c92a2a",
    disconnected: "#212529",
  };
  const STYLE = `
    #head-bar { position: fixed; top: 8px; left: 8px; z-index: 10000; display: flex; gap: 8px;
      align-items: stretch; max-width: calc(100vw - 16px); font: 14px/1.25 system-ui, sans-serif;
      pointer-events: none; }
    #head-bar > * { pointer-events: auto; }
    #head-bar button { min-height: 52px; border: 0; border-radius: 8px; color: #fff; cursor: pointer;
      font: inherit; font-weight: 700; box-shadow: 0 1px 5px #0006; }
    #head-bar button:focus-visible { outline: 3px solid #ffd43b; }
    #head-stop { background: #e03131; font-size: 20px !important; letter-spacing: 1px;
      padding: 0 22px; }
    #head-stop:active { background: #a51111; }
    #head-resume { background: #1971c2; padding: 0 14px; }
    #head-bar button[hidden] { display: none; }
    #head-badge { border-radius: 8px; color: #fff; padding: 6px 12px; min-width: 96px;
      max-width: min(340px, 46vw); box-shadow: 0 1px 5px #0006; overflow-wrap: anywhere; }
    #head-badge b { display: block; text-transform: uppercase; letter-spacing: .5px; }
    #head-badge span { display: block; font-size: 12px; max-height: 62px; overflow: hidden; }
    #head-veil { position: fixed; inset: 0; z-index: 9000; background: #f1f3f588; cursor: not-allowed; }
    #head-veil[hidden] { display: none; }
    .mantine-Notifications-root { top: 72px !important; }
    @media (max-width: 800px) { #head-badge span { max-height: 31px; } }`;
  let heard = performance.now(), told = "", toldUntil = 0;

  const make = (tag, id, text, parent) => {
    const node = document.createElement(tag);
    node.id = id;
    node.textContent = text;
    parent.append(node);
    return node;
  };
  const ask = async (what) => {
    const answer = await fetch(`head/${what}`, {
      headers: { "X-Head-Tracking": "page" }, cache: "no-store", signal: AbortSignal.timeout(5000),
    });
    if (!answer.ok) throw new Error(await answer.text());
    return answer.json();
  };

  const build = () => {
    make("style", "head-style", STYLE, document.head);
    const veil = make("div", "head-veil", "", document.body);
    veil.hidden = true;
    const bar = make("div", "head-bar", "", document.body);
    const stop = make("button", "head-stop", "STOP", bar);
    stop.title = "Relaxes all servos at once (Esc)";
    const resume = make("button", "head-resume", "Resume", bar);
    resume.title = "Commands are taken again; the head moves slowly until it has arrived once";
    resume.hidden = true;
    const badge = make("div", "head-badge", "", bar);
    badge.setAttribute("role", "status");
    const word = make("b", "head-word", "", badge), text = make("span", "head-text", "", badge);

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
    // before anything on the page gets the key
    window.addEventListener("keydown", (event) => {
      if (event.key === "Escape" && !event.repeat) stop.click();
    }, true);

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

    const look = async () => {
      try {
        const status = await ask("status");
        heard = performance.now();
        document.title = status.title;
        resume.hidden = !status.can_resume;
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
  };
  if (document.body) build(); else addEventListener("DOMContentLoaded", build);
})();
