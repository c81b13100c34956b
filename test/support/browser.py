"""Debian's Chromium without a window, driven by Playwright."""

import importlib.util
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from waiting import PATIENCE, wait_for

# WebGL is computed; everything else is drawn without it, which is faster
_ARGUMENTS = ("--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--mute-audio")

_POLITE = Path(__file__).with_name("polite_chromium")
_NEEDED = {
    "nicegui": "pip install -r requirements/viewer.txt",
    "mcap_ros2": "pip install -r requirements/viewer.txt",
    "playwright": "pip install playwright",
}


class NoBrowser(Exception):
    """Something is missing; says what, and how to get it."""


def chromium() -> str:
    """The path of Chromium.

    Raises:
        NoBrowser: it, or what drives it or serves the page, is missing.
    """
    for library, remedy in _NEEDED.items():
        if importlib.util.find_spec(library) is None:
            raise NoBrowser(f"{library} is missing: {remedy}")
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    if path is None:
        raise NoBrowser("there is no Chromium here: apt install chromium")
    return path


@contextmanager
def open_browser() -> Iterator[Any]:
    """A browser; pages are opened with `open_page`."""
    path = chromium()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=_POLITE,
            args=list(_ARGUMENTS),
            env={**os.environ, "CHROMIUM": path},
        )
        try:
            yield browser
        finally:
            browser.close()


def open_page(
    browser: Any,  # opens it
    port: int,  # where the page is
    width: int = 900,  # of the window [pixels]
    height: int = 700,  # of the window [pixels]
    **context: Any,  # options of Playwright's new_page
) -> Any:
    """Return the page, once the robot is there."""
    page = browser.new_page(viewport={"width": width, "height": height}, **context)
    page.set_default_timeout(1e3 * PATIENCE)
    page.add_init_script("localStorage.setItem('head-welcomed', '1')")
    page.goto(f"http://127.0.0.1:{port}/")
    page.wait_for_function("window.headPage?.shownRobot && window.headPage.about")
    return page


def press(page: Any, name: str) -> None:
    """Click a button by its name, wherever it is scrolled to."""
    button = page.get_by_role("button", name=name).first
    button.wait_for()
    # not waiting for it to stand still, which takes ages where every picture does
    button.dispatch_event("click")


def open_tab(page: Any, name: str) -> None:
    """Go to a place of the page."""
    page.locator(f"#tab-{name.lower()}").dispatch_event("click")
    page.locator(f"#{name.lower()}").wait_for()


def choose(page: Any, menu: str, option: str) -> None:
    """Choose a value from the menu with an id, once it offers that."""
    page.locator(f"#{menu} option[value={option!r}]").wait_for(state="attached")
    page.locator(f"#{menu}").select_option(option)


def choose_mode(page: Any, mode: str) -> None:
    """Press the card of a mode, again where a busy robot refuses, and wait until it has it."""
    card = page.locator(f'#cards button[data-mode="{mode}"]')
    page.wait_for_function(
        "mode => document.querySelector(`#cards button[data-mode='${mode}']`)?.disabled === false",
        arg=mode,
    )

    def is_accepted() -> bool:
        with page.expect_response("**/head/do/mode") as answer:
            card.dispatch_event("click")
        return answer.value.json()["done"]

    wait_for(is_accepted)
    page.locator(f'#cards button[data-mode="{mode}"][aria-pressed=true]').wait_for()


def fill(page: Any, field: str, value: Any) -> None:
    """Type into an input and leave it."""
    page.locator(f"#{field}").fill(str(value))
    page.locator(f"#{field}").press("Enter")


def point_head(page: Any, frame: str, x: float, y: float, z: float) -> None:
    """Point the head at a point of a frame [m]."""
    choose(page, "frame", frame)
    for name, value in zip("xyz", (x, y, z), strict=True):
        page.locator(f"#{name}").fill(str(value))
    page.locator("#go").dispatch_event("click")


def word(page: Any) -> str:
    """Return what the head does, by the pill."""
    return str(page.locator("#pill").get_attribute("data-word"))
