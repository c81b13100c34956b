"""What a visitor of the page of a run waits for, in Debian's chromium."""

import time
from typing import Any

from browser import choose_mode, open_tab, word
from waiting import wait_for

_HAS_PICTURE = "document.getElementById('picture').naturalWidth > 0"


def first_sight(page: Any) -> None:
    """See the robot's name and its camera picture without a click."""
    wait_for(lambda: page.title() == "kinectbot")
    wait_for(lambda: page.evaluate(_HAS_PICTURE))
    wait_for(lambda: word(page) == "on target")


def stays_on_target(page: Any, seconds: float = 2.0) -> None:
    """Wait until the head has been on target for a while [s]."""
    since = time.monotonic()

    def stays() -> bool:
        nonlocal since
        if word(page) != "on target":
            since = time.monotonic()
        return time.monotonic() - since > seconds

    wait_for(stays)


def face(page: Any) -> None:
    """Let the head follow a face."""
    open_tab(page, "live")
    choose_mode(page, "face")
    stays_on_target(page)
    wait_for(lambda: page.locator("#overlay rect").count() > 0)
