"""The page's server over HTTP and its websocket, with a robot whose answers a test decides."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import httpx
import pytest
from websockets.sync.client import connect

from head_tracking.page.server import Page
from head_tracking.ros.other_services import Outcome

_MARK = {"X-Head-Tracking": "page"}


class _Robot:
    """Answers STOP at once; a mode only when the test lets it. Its observations fail."""

    def __init__(self) -> None:
        self.stops, self.go_on, self.asked = 0, threading.Event(), threading.Semaphore(0)
        self.modes = SimpleNamespace(set_mode=self._set_mode, mode=lambda: "nothing")
        self.stop = SimpleNamespace(resume=lambda: Outcome(True, ""))

    def stop_everything(self) -> Outcome:
        self.stops += 1
        return Outcome(True, "relaxed")

    def _set_mode(self, mode: Any, frame: str) -> Outcome:
        self.asked.release()
        self.go_on.wait(60.0)
        return Outcome(True, str(mode))


@pytest.fixture(scope="module")
def robot() -> _Robot:
    return _Robot()


@pytest.fixture(scope="module")
def page(robot: _Robot) -> Iterator[Page]:
    served = Page(robot, lambda _: None, port=0)  # type: ignore[arg-type]
    yield served
    robot.go_on.set()
    served.close()


@pytest.fixture
def client(page: Page) -> Iterator[httpx.Client]:
    transport = httpx.HTTPTransport(retries=5)
    base = f"http://127.0.0.1:{page.port}"
    with httpx.Client(base_url=base, transport=transport, timeout=30.0) as opened:
        yield opened


def test_stop_does_not_wait_for_commands_that_hang(
    robot: _Robot, page: Page, client: httpx.Client
) -> None:
    def ask() -> None:
        httpx.post(
            f"http://127.0.0.1:{page.port}/head/do/mode",
            json={"mode": "face"},
            headers=_MARK,
            timeout=60.0,
        )

    threads = [threading.Thread(target=ask) for _ in range(12)]
    for thread in threads:
        thread.start()
    for _ in range(8):  # every thread for commands is taken
        assert robot.asked.acquire(timeout=30.0)
    before = robot.stops
    assert client.post("/head/stop", headers=_MARK).json() == {"done": True, "text": "relaxed"}
    assert robot.stops == before + 1
    assert all(thread.is_alive() for thread in threads)
    robot.go_on.set()
    for thread in threads:
        thread.join()


def test_stop_needs_the_mark_of_the_page(robot: _Robot, client: httpx.Client) -> None:
    before = robot.stops
    assert client.post("/head/stop").status_code == 403
    assert robot.stops == before


@pytest.mark.parametrize(
    ("name", "body", "status"),
    [
        ("nonsense", b"{}", 404),
        ("mode", b"[1]", 400),
        ("mode", b"\xff", 400),
        ("mode", b"{}", 400),
        ("mode", b'{"mode": "dance"}', 400),
        ("aim", b'{"joints": {"a": "far"}}', 400),
        ("aim", b'{"joints": {"a": NaN}}', 400),
        ("aim", b" " * 70_000, 413),
    ],
)
def test_bad_requests_are_refused(
    client: httpx.Client, name: str, body: bytes, status: int
) -> None:
    assert client.post(f"/head/do/{name}", content=body, headers=_MARK).status_code == status


def test_a_part_that_fails_is_named_and_the_page_goes_on(page: Page) -> None:
    with connect(f"ws://127.0.0.1:{page.port}/head/live") as browser:
        browser.send("\0 nonsense")
        states = [json.loads(browser.recv(timeout=30.0)) for _ in range(3)]
    assert {"robot", "motion", "state"} <= states[-1]["failing"].keys()


def test_three_js_comes_from_the_wheel(client: httpx.Client) -> None:
    index = client.get("/").text
    imports = json.loads(index.partition('<script type="importmap">')[2].partition("</script>")[0])
    module = client.get(imports["imports"]["nicegui-scene"])
    assert module.status_code == 200
    assert all(f" as {name}" in module.text for name in ("THREE", "STLLoader"))
    assert "OrbitControls" in module.text
