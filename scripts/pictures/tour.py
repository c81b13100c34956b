"""Goes through the page of a run in 25 steps and takes a screenshot of each."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from browser import choose, choose_mode, open_browser, open_page, open_tab, point_head, press
from simulated_run import run_with_page

SIZES = ((1280, 800), (1920, 1080), (390, 844))
SCHEMES = ("light", "dark")
SETTLING = 1500  # ms after each step


def welcome(page: Any) -> Iterator[str]:
    """The welcome."""
    for name in ("head", "stop", "follow"):
        page.locator("#welcome").wait_for()
        yield f"welcome-{name}"
        page.locator("#welcome-next").dispatch_event("click")


def modes(page: Any) -> Iterator[str]:
    """The modes."""
    yield "live"
    for mode in ("face", "ball", "marker"):
        choose_mode(page, mode)
        page.wait_for_timeout(2 * SETTLING)
        yield mode
    page.locator("#camera").click(position={"x": 60, "y": 140}, force=True)
    yield "click"
    page.locator("#pad").focus()
    page.keyboard.press("ArrowRight")
    yield "pad"
    choose_mode(page, "point")
    yield "point"
    point_head(page, "base_link", 1.0, 0.4, 0.3)
    yield "pointed"
    choose_mode(page, "path")
    yield "path"
    choose(page, "shape", "figure of eight")
    yield "path-eight"
    choose_mode(page, "nothing")
    yield "hands-off"


def tabs(page: Any) -> Iterator[str]:
    """The other tabs, and STOP."""
    open_tab(page, "joints")
    yield "joints"
    press(page, "Randomise")
    yield "joints-moved"
    open_tab(page, "tune")
    page.locator("#experts").wait_for()
    yield "tune"
    page.evaluate("document.getElementById('experts').open = true")
    page.evaluate("document.getElementById('experts').scrollIntoView()")
    yield "tune-experts"
    open_tab(page, "health")
    yield "health"
    page.evaluate("document.querySelector('#statuses details').open = true")
    yield "health-values"
    open_tab(page, "record")
    yield "record"
    press(page, "Record everything")
    page.get_by_role("button", name="End recording").wait_for()
    yield "recording"
    press(page, "End recording")
    page.get_by_role("button", name="Replay head-").first.click()
    page.locator("#replaying").wait_for()
    yield "replay"
    press(page, "Back to the robot")
    page.locator("#stop").dispatch_event("click")
    page.locator("#resume").wait_for()
    yield "stopped"
    page.locator("#resume").dispatch_event("click")
    choose(page, "source", "none")
    yield "no-picture"


def main() -> int:
    """Take the screenshots of the chosen sizes and schemes, such as 390-dark; default: of all."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    chosen = sys.argv[2:]
    with run_with_page() as (_, port), open_browser() as browser:
        for width, height in SIZES:
            for scheme in SCHEMES:
                if chosen and f"{width}-{scheme}" not in chosen:
                    continue
                page = open_page(browser, port, width, height, welcome=True, color_scheme=scheme)
                page.wait_for_function("document.getElementById('picture').naturalWidth > 0")
                choose_mode(page, "point")
                press(page, "Centre")  # the tour before has ended elsewhere
                steps = itertools.chain(welcome(page), modes(page), tabs(page))
                for number, name in enumerate(steps, 1):
                    page.wait_for_timeout(SETTLING)
                    page.screenshot(path=folder / f"{width}-{scheme}-{number:02d}-{name}.png")
                    print(f"{width} {scheme} {number:2d} {name}", flush=True)
                page.close()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
