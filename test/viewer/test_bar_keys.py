"""The keys of the page's own script, in Node with the few parts of a browser that they need."""

import shutil
import subprocess
from pathlib import Path

import pytest

import head_tracking.viewer

BAR = Path(head_tracking.viewer.__file__).with_name("bar.js")
BROWSER = """
const made = {}, asked = [], listeners = [];
let opened = [], prevented = 0;
const element = () => ({
  style: {}, dataset: {}, classList: { toggle() {}, contains: () => false },
  append() {}, setAttribute() {}, remove() {}, addEventListener() {}, replaceChildren() {},
  click() { this.onclick(); },
  set id(name) { made[name] = this; },
});
const page = {
  document: Object.assign(element(), {
    documentElement: element(), head: element(), body: element(), hidden: false,
    createElement: element, querySelector: () => null, getElementById: () => null,
    querySelectorAll: (what) => opened.filter((one) => what.includes(one.role)),
  }),
  window: { addEventListener: (kind, heard) => { if (kind === "keydown") listeners.push(heard); } },
  matchMedia: () => ({ matches: false, addEventListener() {} }),
  localStorage: { getItem: () => null }, history: { replaceState() {} },
  location: { href: "http://localhost/" }, setInterval() {}, setTimeout() {}, clearTimeout() {},
  fetch: async (what) => { asked.push(what); throw new Error("nobody"); },
};
Function(...Object.keys(page), require("fs").readFileSync(process.argv[1], "utf8"))(
  ...Object.values(page));
const stops = () => asked.filter((one) => one === "head/stop").length;
const press = (key, repeat = false) => listeners.forEach((heard) => heard({ key, repeat }));
const found = [];
const expect = (what, stopped) => found.push([what, stops(), stopped]);
press("Escape"); expect("Esc", 1);
press("Escape", true); expect("Esc held down", 1);
press(" "); press("Enter"); expect("other keys", 1);
for (const role of ["dialog", "listbox"]) {
  opened = [{ role, checkVisibility: () => true }];
  press("Escape"); expect(`Esc with an open ${role}`, 1);
}
opened = [{ role: "dialog", checkVisibility: () => false }];
press("Escape"); expect("Esc with a hidden dialog", 2);
made["head-bar"].onmousedown?.({ preventDefault: () => { prevented += 1; } });
found.push(["a click leaves the focus where it is", prevented, 1]);
const wrong = found.filter(([, is, should]) => is !== should);
if (wrong.length) { console.error(JSON.stringify(wrong)); process.exit(1); }
"""


def node() -> str:
    """Node's program: the machine's, or the one that the browser tests bring."""
    found = shutil.which("node")
    if found is None:
        driver = pytest.importorskip("playwright._impl._driver", reason="there is no node")
        found = driver.compute_driver_executable()[0]
    return found


def test_escape_stops_only_where_nothing_is_open_and_no_key_stops_by_accident():
    command = [node(), "-e", BROWSER, "--", str(BAR)]
    ran = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
    assert ran.returncode == 0, ran.stderr
