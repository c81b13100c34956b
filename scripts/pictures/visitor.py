"""A person before the page of a run, in Debian's chromium."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from browser import choose_mode, open_tab

PATIENCE = 60.0  # s: without a graphics card a browser takes its time
_HAS_PICTURE = "document.getElementById('picture').naturalWidth > 0"


class Failed(Exception):
    """A step did not do what it says; says what was there instead."""


class Visitor:
    """A person before a page, whom it does not welcome any more.

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
        """What the head does, by the pill."""
        return str(self.page.locator("#pill").get_attribute("data-word"))

    def sees(self, what: str, is_so: Callable[[], Any]) -> None:
        """Wait until something is so.

        Raises:
            Failed: it has not become so; says what the page showed.
        """
        deadline = time.monotonic() + PATIENCE
        while not is_so():
            if time.monotonic() > deadline:
                pill = " ".join(self.page.locator("#pill").inner_text().split())
                mode = self.page.evaluate("headPage.about.mode")
                raise Failed(f"{what}: not so within {PATIENCE:.0f} s; {pill}; looks at {mode}")
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
    """The robot by its name, and what its camera sees, without a click."""
    visitor.sees("the robot's name", lambda: visitor.page.title() == "kinectbot")
    visitor.sees("the camera's picture", lambda: visitor.page.evaluate(_HAS_PICTURE))
    visitor.sees("on target", lambda: visitor.word == "on target")


def face(visitor: Visitor) -> None:
    """The head follows a face that its camera finds."""
    open_tab(visitor.page, "live")
    choose_mode(visitor.page, "face")
    visitor.stays_on_target()
    visitor.sees("a box", lambda: visitor.page.locator("#overlay rect").count() > 0)
