"""Takes pictures of the viewer's page in Debian's chromium: docs/viewer*.png."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import rclpy
from browser import PATIENCE, choose, open_browser, open_page, open_tab, press, row

from head_tracking.nodes.viewer import ViewerNode
from head_tracking.ros.spinning import NodeThreads
from head_tracking.runner import compose, parse_arguments, ros_arguments

SIZE = (1200, 760)
SETTLING = 6.0  # s: trails and plots need something to show


def wait_for(what: Callable[[], Any]) -> None:
    """Polls until `what` gives something true."""
    deadline = time.monotonic() + PATIENCE
    while not what():
        if time.monotonic() > deadline:
            raise SystemExit("the page did not become what it should be")
        time.sleep(0.1)


def take(page: Any, path: Path) -> None:
    """Takes a picture; the first one of a page also compiles its shaders."""
    page.screenshot()
    page.wait_for_timeout(1e3)
    page.screenshot(path=path)
    print(f"took {path}")


def tour(page: Any, folder: Path, has_picture: Callable[[], bool]) -> None:
    """Pictures of the tabs."""
    page.wait_for_timeout(1e3 * SETTLING)
    close = page.locator("button[class*=CloseButton], [class*=closeButton]")
    for button in close.all():
        button.dispatch_event("click")
    press(page, "Simulate the camera")
    wait_for(has_picture)
    page.wait_for_timeout(1e3 * SETTLING)
    take(page, folder / "viewer.png")
    for tab in ("Joints", "Tune", "Health", "View"):
        open_tab(page, tab)
        if tab == "View":
            choose(page, "Frames", "all frames")
            row(page, "Reachable field").locator("input").first.click(force=True)
        page.wait_for_timeout(1e3)
        take(page, folder / f"viewer-{tab.lower()}.png")


def main() -> None:
    """Runs a simulated head and takes pictures of its page."""
    folder = Path(sys.argv[1])
    plan = parse_arguments(["--sim", "--viewer"])
    rclpy.init(args=ros_arguments(plan))
    with ExitStack() as resources, closing(NodeThreads()) as threads:
        head = compose(plan, threads, resources)
        node = ViewerNode(head.buffer)
        threads.start(node)
        viewer = node.page
        with open_browser() as browser:
            page = open_page(browser, viewer.port, *SIZE, sharpness=1.0)
            wait_for(lambda: viewer.browsers)
            tour(page, folder, lambda: node.robot.topics.picture("/image") is not None)
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
