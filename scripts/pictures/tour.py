"""A newcomer's ten minutes with the page, in Debian's chromium: each step a picture, and checked.

The program is run as a person runs it, and the page is all that is looked at. Ends with 1 if a step
did not do what it says.
"""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from browser import choose, drag, open_browser, open_tab, press, row, type_number

PATIENCE = 60.0  # s: without a graphics card a browser takes its time
SIZES = {"wide": (1920, 1080), "phone": (390, 844)}
_MEAN = """() => {
  const image = document.getElementById("head-image");
  if (!image?.naturalWidth) return null;
  const canvas = document.createElement("canvas").getContext("2d");
  canvas.drawImage(image, 0, 0, 1, 1);
  return [...canvas.getImageData(0, 0, 1, 1).data.slice(0, 3)];
}"""
_CUT = """() => [...document.querySelectorAll("button, input, [role=tab], #head-bar > *")].filter(
  (one) => {
    const {left, right, width} = one.getBoundingClientRect();
    return width && one.checkVisibility() && (left < -1 || right > innerWidth + 1);
  }).map((one) => one.id || one.textContent || one.placeholder)"""
_HIDDEN = """() => {
  const {left, top, width, height} = document.getElementById("head-stop").getBoundingClientRect();
  if (height < 48) return `STOP is ${height} px high`;
  const there = document.elementFromPoint(left + width / 2, top + height / 2);
  return there?.id === "head-stop" ? "" : `above STOP lies ${there?.outerHTML.slice(0, 80)}`;
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

    def angle(self, name: str) -> float:
        """`pan`, `tilt` or `error` at the top of the panel, in degrees."""
        text = self.text(name).removesuffix("°")
        return float(text) if re.fullmatch(r"-?[\d.]+", text) else float("nan")

    def sees(self, what: str, is_so: Callable[[], Any], patience: float = PATIENCE) -> None:
        """Waits until something is so.

        Raises:
            Failed: it has not become so; says what the page said.
        """
        deadline = time.monotonic() + patience
        while not is_so():
            if time.monotonic() > deadline:
                bar = " ".join(self.text("head-badge").split())
                raise Failed(
                    f"{what}: not so within {patience:.0f} s; the badge: {bar}; looks at "
                    f"{self.text('mode')}; pan {self.text('pan')}, tilt {self.text('tilt')}"
                )
            self.page.wait_for_timeout(100)

    def looks_at(self, mode: str, *, arrives: bool = True) -> None:
        """Chooses what to look at, and waits for it."""
        open_tab(self.page, "Steer")
        choose(self.page, "Look at", mode)
        self.sees(f"it looks at {mode}", lambda: self.text("mode") == mode)
        if arrives:
            self.stays_on_target()

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
    visitor.looks_at("face")
    chosen = row(visitor.page, "Camera picture").locator("input").first
    visitor.sees("detections", lambda: chosen.input_value() == "/visual_target/image")


def ball(visitor: Visitor) -> None:
    """The head follows a ball."""
    visitor.looks_at("ball")


def point(visitor: Visitor) -> None:
    """The head looks at a point by its numbers: 1 m ahead, half a metre to the left."""
    visitor.looks_at("point", arrives=False)
    choose(visitor.page, "Frame", "base_link")
    type_number(visitor.page, "x y z (m)", 1.0, 0.5, 0.5)
    press(visitor.page, "Point head")
    visitor.sees("pan 26.8°", lambda: abs(visitor.angle("pan") - 26.8) < 1.5)
    visitor.sees("on target", lambda: visitor.word == "on target")


def refused(visitor: Visitor) -> None:
    """A point behind the head is refused in red, with the reason, and nothing moves."""
    before = visitor.angle("pan")
    type_number(visitor.page, "x y z (m)", -1.0, 0.0, 0.5)
    press(visitor.page, "Point head")
    visitor.sees("a refusal", lambda: visitor.page.get_by_text("out of reach").count())
    if abs(visitor.angle("pan") - before) > 1.0:
        raise Failed(f"the head has moved from {before}° to {visitor.angle('pan')}°")
    visitor.close_notices()


def dragged(visitor: Visitor) -> None:
    """The target is dragged by its arrow to the right."""
    type_number(visitor.page, "x y z (m)", 1.0, 0.2, 0.5)
    press(visitor.page, "Point head")
    visitor.sees("pan 11.4°", lambda: abs(visitor.angle("pan") - 11.4) < 1.5)
    visitor.page.wait_for_timeout(2e3)  # the arrows follow what was sent
    drag(visitor.page, "/gizmo", (0.0, 0.1, 0.0), (0.0, -0.3, 0.0))
    visitor.sees("the head follows", lambda: visitor.angle("pan") < 0.0)


def clicked(visitor: Visitor) -> None:
    """A click at the left edge of the camera's picture turns the head to the left."""
    before = visitor.angle("pan")
    box = visitor.page.locator("#head-image").bounding_box()
    visitor.page.mouse.click(box["x"] + 0.1 * box["width"], box["y"] + 0.5 * box["height"])
    visitor.sees("20° to the left", lambda: 15.0 < visitor.angle("pan") - before < 30.0)


def floor(visitor: Visitor) -> None:
    """A click on the floor, too: the head looks down there."""
    canvas = visitor.page.locator("canvas[data-engine]").bounding_box()
    visitor.page.mouse.click(
        canvas["x"] + 0.62 * canvas["width"], canvas["y"] + 0.62 * canvas["height"]
    )
    visitor.sees("it looks down", lambda: visitor.angle("tilt") > 10.0)
    visitor.sees("on target", lambda: visitor.word == "on target")


def path(visitor: Visitor) -> None:
    """The head looks along a figure of eight."""
    visitor.looks_at("path")
    choose(visitor.page, "Shape", "figure of eight")
    visitor.sees("it looks to the left", lambda: visitor.angle("pan") > 8.0)
    visitor.sees("and to the right", lambda: visitor.angle("pan") < -8.0)
    visitor.page.wait_for_timeout(4e3)


def joints(visitor: Visitor) -> None:
    """A slider for each joint, and its torque."""
    open_tab(visitor.page, "Joints")
    row(visitor.page, "head_pan_joint").first.wait_for()


def tune(visitor: Visitor) -> None:
    """The law and what can be tuned of it."""
    open_tab(visitor.page, "Tune")
    visitor.page.get_by_text("law", exact=False).first.wait_for()


def health(visitor: Visitor) -> None:
    """Temperatures, voltages and rates of the servos."""
    open_tab(visitor.page, "Health")
    visitor.sees("both servos", lambda: visitor.page.get_by_text("head_tilt_joint").count())


def view(visitor: Visitor) -> None:
    """All frames with their names, and the field that the head can reach."""
    open_tab(visitor.page, "View")
    choose(visitor.page, "Frames", "all frames")
    row(visitor.page, "Reachable field").locator("input").first.click(force=True)
    visitor.sees("its colour", lambda: "reach" in visitor.text("head-legend"))


def replay(visitor: Visitor) -> None:
    """The last minute once more; the badge says that it is no live picture."""
    choose(visitor.page, "Frames", "none")
    row(visitor.page, "Reachable field").locator("input").first.click(force=True)
    open_tab(visitor.page, "Record")
    press(visitor.page, "Replay the last minute")
    visitor.sees("REPLAY", lambda: visitor.word == "replay")


def live(visitor: Visitor) -> None:
    """Back to the robot."""
    press(visitor.page, "Back to the robot")
    visitor.sees("the robot again", lambda: visitor.word != "replay")
    visitor.looks_at("fictitious target")


def stop(visitor: Visitor) -> None:
    """STOP relaxes both servos at once, and says so by name."""
    press(visitor.page, "STOP")
    visitor.sees("STOPPED", lambda: visitor.word == "stopped", 2.0)
    visitor.sees("tilt", lambda: "head_tilt_joint relaxed" in visitor.text("head-text"))


def reloaded(visitor: Visitor) -> None:
    """It is stopped still after the page was loaded again, and the head has not moved."""
    visitor.page.reload()
    visitor.page.get_by_role("tab", name="Joints").wait_for()
    visitor.sees("STOPPED", lambda: visitor.word == "stopped")
    visitor.close_notices()


def resume(visitor: Visitor) -> None:
    """Resume: it goes on, slowly at first."""
    press(visitor.page, "Resume")
    visitor.sees("on target", lambda: visitor.word == "on target")


def is_whole(visitor: Visitor) -> None:
    """STOP is in view and high enough on every tab, and nothing is cut off at the sides."""
    visitor.close_notices()
    visitor.sees("the camera's picture", lambda: visitor.page.evaluate(_MEAN))
    for tab in ("Joints", "Tune", "Health", "View", "Record", "Steer"):
        open_tab(visitor.page, tab)
        visitor.page.wait_for_timeout(300)
        hidden, cut = visitor.page.evaluate(_HIDDEN), visitor.page.evaluate(_CUT)
        if hidden or cut:
            raise Failed(f"{tab}: {hidden or f'cut off: {cut}'}")


def folded(visitor: Visitor) -> None:
    """On a phone the panel folds away to a line, and the scene takes its place."""
    visitor.page.get_by_text("kinectbot").first.click()
    visitor.page.wait_for_timeout(1.5e3)
    height = visitor.page.evaluate("document.querySelector('canvas[data-engine]').clientHeight")
    if height < 700:
        raise Failed(f"the scene is {height} px high")


def gone(visitor: Visitor) -> None:
    """The program has ended: the page says so and takes no input."""
    visitor.sees("DISCONNECTED", lambda: visitor.word == "disconnected")


STEPS = (
    first_sight, face, ball, point, refused, dragged, clicked, floor, path, joints, tune, health,
    view, replay, live, stop, reloaded, resume,
)  # fmt: skip


class Tour:
    """Takes the pictures, and counts what went wrong."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.failures = 0
        self._taken = 0

    def step(self, visitor: Visitor, do: Callable[[Visitor], None], name: str = "") -> None:
        """Does a step and takes its picture, however that went."""
        self._taken += 1
        name = name or do.__name__.replace("_", "-")
        try:
            do(visitor)
            said = "as it should be"
        except Exception as error:
            # the next steps may do better
            self.failures += 1
            said = f"FAILED: {str(error).splitlines()[0]}"
        visitor.page.screenshot(path=self.folder / f"{self._taken:02}-{name}.png")
        print(f"{self._taken:02} {name}: {said}", flush=True)


@contextmanager
def running(port: int, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """The program with its page at a port, as a person starts it."""
    command = [sys.executable, "-m", "head_tracking", "--sim", "--viewer", *arguments]
    domain = os.environ.get("ROS_DOMAIN_ID", str(10 + os.getpid() % 80))
    program = subprocess.Popen(
        [*command, "--ros-args", "-p", f"viewer:port:={port}"],
        env={**os.environ, "ROS_DOMAIN_ID": domain, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        deadline = time.monotonic() + PATIENCE
        while socket.socket().connect_ex(("127.0.0.1", port)):
            if program.poll() is not None or time.monotonic() > deadline:
                raise SystemExit("the program does not start; try scripts/run --sim --viewer")
            time.sleep(0.2)
        yield program
    finally:
        program.send_signal(signal.SIGINT)
        program.wait(PATIENCE)


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def main() -> int:
    """Goes through all steps; 1 if one failed."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    tour, port = Tour(folder), free_port()
    with open_browser() as browser:

        def visit(size: tuple[int, int], scheme: str) -> Visitor:
            width, height = size
            return Visitor(
                browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme),
                port,
            )

        with running(port):
            visitor = visit((1280, 800), "light")
            for do in STEPS:
                tour.step(visitor, do)
            visitor.page.close()
            for name, size in SIZES.items():
                for scheme in ("light", "dark"):
                    visitor = visit(size, scheme)
                    tour.step(visitor, is_whole, f"{name}-{scheme}")
                    if name == "phone" and scheme == "dark":
                        tour.step(visitor, folded)
                    visitor.page.close()
            visitor = visit((1280, 800), "dark")
            tour.step(visitor, is_whole, "dark")
        tour.step(visitor, gone)
    print(f"{tour.failures} of the steps failed; the pictures are in {folder}")
    return 1 if tour.failures else 0


if __name__ == "__main__":
    raise SystemExit(main())
