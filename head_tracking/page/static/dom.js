// Helpers for the page's elements, and requests to its server.
const SVG = "http://www.w3.org/2000/svg", PERIOD = 50, SLIDE = 8; // ms, pixels

export const by = (id) => document.getElementById(id);
export const degrees = (radians) => (radians * 180) / Math.PI;
export const radians = (angle) => (angle * Math.PI) / 180;

/** Add an element to a parent; SVG below SVG. */
export function element(parent, name, attributes = {}, text = "") {
  const made = name === "svg" || parent.namespaceURI === SVG ? document.createElementNS(SVG, name) : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text) made.textContent = text;
  return parent.appendChild(made);
}

/** Add a button with its action. */
export function button(parent, text, act, attributes = {}) {
  const made = element(parent, "button", { type: "button", ...attributes }, text);
  made.onclick = act;
  return made;
}

/** Set a text only if it changes: screen readers announce each change. */
export function write(node, text) { if (node.textContent !== text) node.textContent = text; }

/**
 * Show items in the rows of a list. A row stays while its key does: one that is built anew loses a click and the focus.
 * @param {(row: Element, item: any) => void} build fills a new row.
 * @param {(row: Element, item: any) => void} update shows what the key does not have.
 */
export function rows(list, name, items, build, update = () => {}, keyOf = JSON.stringify) {
  const known = new Map([...list.children].map((row) => [row.key, row]));
  for (const [number, item] of items.entries()) {
    const key = keyOf(item);
    let row = known.get(key);
    if (!known.delete(key)) {
      row = element(list, name);
      build(row, item);
      row.key = key;
    }
    if (list.children[number] !== row) list.insertBefore(row, list.children[number]);
    update(row, item);
  }
  for (const row of [...list.children].slice(items.length)) row.remove();
}

/** Offer options in a menu; the choice stays while it is still offered. */
export function offer(menu, options, chosen = menu.value) {
  rows(menu, "option", options, (option, [value, text]) => Object.assign(option, { value, textContent: text }));
  if (options.some(([value]) => value === chosen)) menu.value = chosen;
}

export function toast(text, seconds = 6) {
  const node = by("toast");
  write(node, text);
  node.hidden = !text;
  clearTimeout(toast.timer);
  toast.timer = setTimeout(() => { node.hidden = true; }, 1000 * seconds);
}

/** Return what this browser keeps under a name, after a new value is kept; null where it may keep nothing. */
export function kept(name, value) {
  try { if (value) localStorage.setItem(name, value); return localStorage.getItem(name); } catch { return null; }
}

let pending = new AbortController();

/** Give up the requests that wait: a browser has six connections to a server, and STOP needs one. */
export function abort() { pending.abort(); pending = new AbortController(); }

const NO_ANSWER = "The page's server does not answer. Use the power switch of the servos if they must stop.";

/** Send a request to the server; resolve with its answer, or {done: false}. A refusal is shown, and that no answer has come within `patience` [ms; 0: wait]. */
export async function send(path, body = {}, method = "POST", patience = 0) {
  const { signal } = pending;
  const timer = patience && setTimeout(() => toast(NO_ANSWER, 12), patience); // it may still arrive
  try {
    const answer = await fetch(path, { method, signal, headers: { "X-Head-Tracking": "page" }, ...(method === "POST" && { body: body instanceof Blob ? body : JSON.stringify(body) }) });
    const isJson = (answer.headers.get("Content-Type") ?? "").includes("json");
    const outcome = isJson ? await answer.json() : { done: false, text: await answer.text() };
    if (outcome.done === false) toast(outcome.text, 12);
    return outcome;
  } catch {
    if (!signal.aborted) toast(NO_ANSWER, 12);
    return { done: false, text: "" };
  } finally { clearTimeout(timer); }
}

/** Return why the server refuses this browser, such as an old token; empty: it does not, or does not answer within 5 s. */
export async function refusalOf(path) {
  return fetch(path, { signal: AbortSignal.timeout(5000), cache: "no-store" }).then((answer) => (answer.ok ? "" : answer.text())).catch(() => "");
}
export const get = (path) => send(path, null, "GET");

let refusal = "", stops;

/** Refuse commands from now on, for a reason; empty: send them. */
export function refuse(why) { refusal = why; }

/** Note the number of STOPs: the robot refuses a command that was sent before another STOP was known. */
export function know(number) { stops = number; }

/** Send a command to the robot, unless commands are refused. */
export function command(name, body) {
  if (refusal) toast(refusal);
  return refusal ? Promise.resolve({ done: false, text: refusal }) : send(`/head/do/${name}`, { ...body, stops });
}

/** Return a function that sends values one after the other, 20 a second at most. Meanwhile only the latest is kept. */
export function latestOnly(send) {
  let next = null, isSending = false;
  const add = async (...values) => {
    next = values;
    if (isSending) return;
    isSending = true;
    try {
      while (next) {
        const present = next;
        next = null;
        await Promise.all([send(...present), new Promise((resolve) => setTimeout(resolve, PERIOD))]);
      }
    } finally { isSending = false; }
  };
  return Object.assign(add, { giveUp: () => { next = null; } });
}

/** Return whether the user changes an input now: it must not be overwritten. */
export const isHeld = (input) => document.activeElement === input || performance.now() < (input.heldUntil ?? 0);
export function hold(input) { input.heldUntil = performance.now() + 1500; }

/** Let a slider under a finger change only once that moves along it: whoever scrolls the page over it does not mean it. */
export function guardSliders() {
  let touched = null;
  const listen = (kind, act) => document.addEventListener(kind, (event) => touched?.slider === event.target && act(event), { capture: true });
  listen("pointermove", ({ clientX }) => { if (Math.abs(clientX - touched.x) > SLIDE) touched = null; });
  listen("pointerup", ({ target }) => { touched = null; target.dispatchEvent(new Event("input")); });
  listen("pointercancel", ({ target }) => { target.value = touched.value; });
  for (const kind of ["input", "change"]) listen(kind, (event) => event.stopPropagation());
  document.addEventListener("pointerdown", ({ target, pointerType, clientX }) => {
    touched = pointerType === "touch" && target.type === "range" ? { slider: target, x: clientX, value: target.value } : null;
  }, { capture: true });
}
