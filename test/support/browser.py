"""Debian's Chromium without a window, driven by Playwright."""

from __future__ import annotations

import importlib.util
import io
import os
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

PATIENCE = 120.0
"""Without a graphics card on a loaded machine a page takes its time [s]."""

# WebGL is computed; everything else is drawn without it, which is faster
_ARGUMENTS = ("--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--mute-audio")

_POLITE = Path(__file__).with_name("polite_chromium")
_ON_SCREEN = """([name, x, y, z]) => {
  const {nodeRefFromName, camera, canvas} = window.__viserMutable, node = nodeRefFromName[name];
  node.updateWorldMatrix(true, false);
  camera.updateMatrixWorld();
  const point = node.position.clone().set(x, y, z).applyMatrix4(node.matrixWorld).project(camera);
  const {left, top, width, height} = canvas.getBoundingClientRect();
  return [left + (point.x + 1) / 2 * width, top + (1 - point.y) / 2 * height];
}"""

_NEEDED = {
    "viser": "pip install -r requirements/viewer.txt",
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

    # only root can go before others, and what keeps it from that is only for root
    polite = os.geteuid() == 0 and shutil.which("setpriv") is not None
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=_POLITE if polite else path,
            args=list(_ARGUMENTS),
            env={**os.environ, "CHROMIUM": path},
        )
        try:
            yield browser
        finally:
            browser.close()


def open_page(
    browser: Any, port: int, width: int = 900, height: int = 700, sharpness: float = 0.5
) -> Any:
    """The viewer's page, once its control panel is there."""
    page = browser.new_page(viewport={"width": width, "height": height})
    page.set_default_timeout(1e3 * PATIENCE)
    page.goto(f"http://127.0.0.1:{port}/?fixedDpr={sharpness}")
    page.get_by_role("tab", name="Joints").wait_for()
    return page


def press(page: Any, name: str) -> None:
    """Clicks a button, wherever it is scrolled to."""
    # not waiting for it to stand still, which takes ages where every picture does
    page.get_by_role("button", name=name).first.click(force=True)


def open_tab(page: Any, name: str) -> None:
    """Brings a tab of the control panel to the front."""
    tab = page.get_by_role("tab", name=name)
    deadline = time.monotonic() + PATIENCE
    while tab.get_attribute("aria-selected") != "true":
        assert time.monotonic() < deadline, f"the tab {name} does not open"
        tab.click(force=True)
        page.wait_for_timeout(200)


def row(page: Any, label: str) -> Any:
    """The line of the control panel with this label."""
    labels = page.locator("label").filter(has_text=re.compile(f"^{re.escape(label)}$"))
    return labels.locator("xpath=ancestor::*[.//input][1]").first


def choose(page: Any, label: str, option: str) -> None:
    """Chooses from a menu."""
    entry = page.get_by_role("option", name=option, exact=True)
    deadline = time.monotonic() + PATIENCE
    while not entry.is_visible():
        assert time.monotonic() < deadline, f"the menu {label} does not open, or has no {option}"
        row(page, label).locator("input").first.click(force=True)
        page.wait_for_timeout(1e3)  # a busy page opens it late, and a click too many closes it
    entry.click(force=True)


def type_number(page: Any, label: str, *values: float) -> None:
    """Types into the number fields of a line, and leaves each."""
    fields = row(page, label).locator("input:visible")
    for field, value in zip(fields.all(), values, strict=False):
        field.fill(str(value))
        field.press("Enter")


def node_position(page: Any, name: str) -> tuple[float, ...]:
    """Where the page draws a node of the scene, in its parent [m]."""
    return tuple(page.evaluate(f"window.__viserMutable.nodePoseData[{name!r}].position"))


def node_wxyz(page: Any, name: str) -> tuple[float, ...]:
    """How the page turns a node of the scene, in its parent."""
    return tuple(page.evaluate(f"window.__viserMutable.nodePoseData[{name!r}].wxyz"))


_TWO_FRAMES = "() => new Promise((d) => requestAnimationFrame(() => requestAnimationFrame(d)))"


def drag(
    page: Any, name: str, start: tuple[float, float, float], end: tuple[float, float, float]
) -> None:
    """Drags with the mouse from one point of a node of the scene to another, in its frame [m]."""
    (x, y), (to_x, to_y) = (page.evaluate(_ON_SCREEN, [name, *point]) for point in (start, end))
    page.mouse.move(x, y)
    page.evaluate(_TWO_FRAMES)  # what lies under the mouse is found out when a frame is drawn
    page.mouse.down()
    page.mouse.move(to_x, to_y, steps=4)
    page.mouse.up()


def pixels(page: Any) -> npt.NDArray[np.uint8]:
    """The page as it looks, shape (height, width, 3)."""
    import imageio.v3 as iio

    return np.asarray(iio.imread(io.BytesIO(page.screenshot())))[..., :3]
