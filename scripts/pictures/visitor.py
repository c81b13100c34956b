"""A person before the page of a run, in Debian's chromium."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from browser import choose, open_tab, row

PATIENCE = 60.0  # s: without a graphics card a browser takes its time
_MEAN = """() => {
  const image = document.getElementById("head-image");
  if (!image?.naturalWidth) return null;
  const canvas = document.createElement("canvas").getContext("2d");
  canvas.drawImage(image, 0, 0, 1, 1);
  return [...canvas.getImageData(0, 0, 1, 1).data.slice(0, 3)];
}"""


class Failed(Exception):
    """A step did not do what it says; says what was there instead."""


class Visitor:
    """A person before a page.

    Attributes:
        page: Playwright's.
    """

    def __init__(self, page: Any, port: int) -> None:
        self.page = page
        self.page.set_default_timeout(1e3 * PATIENCE)
        self.page.goto(f"http://127.0.0.1:{port}/?fixedDpr=1.0")
        self.page.get_by_role("tab", name="Joints").wait_for()

    def text(self, name: str) -> str:
        """The text of an element; empty if it is not there."""
        found = self.page.locator(f"#{name}")
        return str(found.first.inner_text()) if found.count() else ""

    @property
    def word(self) -> str:
        """What the badge says."""
        return self.text("head-word").lower()

    def sees(self, what: str, is_so: Callable[[], Any]) -> None:
        """Waits until something is so.

        Raises:
            Failed: it has not become so; says what the page said.
        """
        deadline = time.monotonic() + PATIENCE
        while not is_so():
            if time.monotonic() > deadline:
                bar = " ".join(self.text("head-badge").split())
                raise Failed(
                    f"{what}: not so within {PATIENCE:.0f} s; the badge: {bar}; looks at "
                    f"{self.text('mode')}; pan {self.text('pan')}, tilt {self.text('tilt')}"
                )
            self.page.wait_for_timeout(100)

    def stays_on_target(self, seconds: float = 2.0) -> None:
        """Waits until the badge has said so for a while: at first it tells of what was before."""
        since = time.monotonic()

        def stays() -> bool:
            nonlocal since
            if self.word != "on target":
                since = time.monotonic()
            return time.monotonic() - since > seconds

        self.sees("on target, and stays so", stays)

    def close_notices(self) -> None:
        """Closes what viser says about the browser, and what else pops up."""
        for button in self.page.locator(".mantine-Notification-closeButton").all():
            button.dispatch_event("click")


def first_sight(visitor: Visitor) -> None:
    """The robot by its name, what its camera sees, and what the colours mean, without a click."""
    visitor.sees("the robot's name", lambda: visitor.page.title() == "kinectbot")
    visitor.sees("the camera's picture", lambda: visitor.page.evaluate(_MEAN))
    visitor.sees("a legend", lambda: "target" in visitor.text("head-legend"))
    visitor.sees("on target", lambda: visitor.word == "on target")
    visitor.close_notices()


def face(visitor: Visitor) -> None:
    """The head follows a face that its camera finds."""
    open_tab(visitor.page, "Steer")
    choose(visitor.page, "Look at", "face")
    visitor.sees("it looks at a face", lambda: visitor.text("mode") == "face")
    visitor.stays_on_target()
    chosen = row(visitor.page, "Camera picture").locator("input").first
    visitor.sees("detections", lambda: chosen.input_value() == "/visual_target/image")
