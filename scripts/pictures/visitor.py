"""A visitor of the page of a run, in Debian's chromium."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from browser import choose_mode, open_tab

PATIENCE = 60.0  # s: without a graphics card a browser takes its time
_HAS_PICTURE = "document.getElementById('picture').naturalWidth > 0"


class Failed(Exception):
    """A step did not have the expected result."""


class Visitor:
    """A visitor of a page, without the welcome.

    Attributes:
        page: Playwright's.
    """

    def __init__(self, page: Any, port: int) -> None:
        self.page = page
        self.page.set_default_timeout(1e3 * PATIENCE)
        self.page.add_init_script("localStorage.setItem('head-welcomed', '1')")
        self.page.goto(f"http://127.0.0.1:{port}/")
        self.page.wait_for_function("window.headPage?.shownRobot && window.headPage.about")

    @property
    def word(self) -> str:
        """The status of the head."""
        return str(self.page.locator("#pill").get_attribute("data-word"))

    def sees(self, what: str, is_so: Callable[[], Any]) -> None:
        """Wait until a condition holds.

        Raises:
            Failed: it has not become true; with what the page showed.
        """
        deadline = time.monotonic() + PATIENCE
        while not is_so():
            if time.monotonic() > deadline:
                pill = " ".join(self.page.locator("#pill").inner_text().split())
                mode = self.page.evaluate("headPage.about.mode")
                raise Failed(f"{what}: not within {PATIENCE:.0f} s; {pill}; looks at {mode}")
            self.page.wait_for_timeout(100)

    def stays_on_target(self, seconds: float = 2.0) -> None:
        """Wait until the head has been on target for a while [s]."""
        since = time.monotonic()

        def stays() -> bool:
            nonlocal since
            if self.word != "on target":
                since = time.monotonic()
            return time.monotonic() - since > seconds

        self.sees("on target, and stays so", stays)


def first_sight(visitor: Visitor) -> None:
    """See the robot's name and its camera picture without a click."""
    visitor.sees("the robot's name", lambda: visitor.page.title() == "kinectbot")
    visitor.sees("the camera's picture", lambda: visitor.page.evaluate(_HAS_PICTURE))
    visitor.sees("on target", lambda: visitor.word == "on target")


def face(visitor: Visitor) -> None:
    """Let the head follow a face."""
    open_tab(visitor.page, "live")
    choose_mode(visitor.page, "face")
    visitor.stays_on_target()
    visitor.sees("a box", lambda: visitor.page.locator("#overlay rect").count() > 0)
