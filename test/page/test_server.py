"""The page's server over HTTP and its websocket, with a robot whose answers a test decides."""

import contextlib
import json
import re
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from io import BytesIO
from types import SimpleNamespace
from typing import Any

import httpx
import pytest
from viewing import until, watch
from waiting import PATIENCE, wait_for
from websockets.exceptions import ConnectionClosed

from head_tracking.page import server
from head_tracking.page.replay import Replays
from head_tracking.page.server import Page, PageParameters
from head_tracking.page.stop import Attempt, Outcome
from head_tracking.parameters import ParameterError
from head_tracking.recording.recording import Observation, Recording
from head_tracking.share import robot_file
from head_tracking.transforms import load_robot_model

_MARK = {"X-Head-Tracking": "page"}
_COMMANDS = 8  # that are carried out at a time


class _Robot:
    """Answers STOP at once; a mode only when the test lets it. Its observations fail."""

    def __init__(self) -> None:
        self.stops, self.go_on, self.asked = 0, threading.Event(), threading.Semaphore(0)
        self.modes = SimpleNamespace(set_mode=self._set_mode)
        self.joints = SimpleNamespace(move=None)
        self.recorder = SimpleNamespace(files=tuple)
        self.parameters = SimpleNamespace(settings=tuple)
        self.stop = SimpleNamespace(resume=lambda: "", require=lambda stops: None, count=0)

    def poll(self) -> None:
        raise RuntimeError("the robot fails")

    model = observe = poll

    def stop_everything(self) -> Attempt:
        self.stops += 1
        attempt = Attempt("here")
        attempt.outcome = Outcome(True, "relaxed")
        attempt.end()
        return attempt

    def _set_mode(self, mode: Any, frame: str) -> None:
        self.asked.release()
        self.go_on.wait(60.0)


@pytest.fixture(scope="module")
def robot():
    return _Robot()


def serve(robot: _Robot, **parameters: Any) -> Page:
    return Page(robot, PageParameters(**parameters), print)


@pytest.fixture(scope="module")
def page(robot):
    served = serve(robot, port=0, max_browsers=2)
    yield served
    robot.go_on.set()
    served.close()


@pytest.fixture
def client(page):
    base = f"http://127.0.0.1:{page.port}"
    with httpx.Client(base_url=base, headers=_MARK, timeout=60.0) as opened:
        yield opened


def test_stop_does_not_wait_for_commands_that_hang(robot, client):
    def ask(_):
        return client.post("/head/do/mode", json={"mode": "face"}).is_success

    with ThreadPoolExecutor(_COMMANDS) as browsers:
        asked = browsers.map(ask, range(_COMMANDS))
        for _ in range(_COMMANDS):
            assert robot.asked.acquire(timeout=30.0)
        before = robot.stops
        assert client.post("/head/stop").json() == {"done": True, "text": "relaxed"}
        assert robot.stops == before + 1
        robot.go_on.set()
        assert all(asked)


@contextmanager
def visited(
    browser: Any, port: int, script: str = "", network: Callable[[Any], None] | None = None
) -> Iterator[Any]:
    """The page in a browser that has seen nothing before, in which a script ran first."""
    with browser.new_context(viewport={"width": 700, "height": 600}) as context:
        if network is not None:
            context.route_web_socket("**/head/live", network)
        tab = context.new_page()
        tab.set_default_timeout(1e3 * PATIENCE)
        tab.add_init_script(script)
        tab.goto(f"http://127.0.0.1:{port}/")
        yield tab


@pytest.fixture
def tab(browser, page):
    """The page in a browser, once it has heard of the robot."""
    with visited(browser, page.port) as opened:
        opened.wait_for_function("window.headPage?.about")
        yield opened


def test_stop_does_not_wait_for_a_connection_of_the_browser(robot, tab):
    """A browser opens six to a server; here, a request hangs in each."""
    robot.go_on.clear()
    tab.evaluate(
        """async () => {
          const { command } = await import("/head/static/dom.js");
          for (let number = 0; number < 6; number += 1) command("mode", { mode: "face" });
        }"""
    )
    for _ in range(6):
        assert robot.asked.acquire(timeout=30.0)
    before = robot.stops
    tab.locator("#stop").dispatch_event("click")
    wait_for(lambda: robot.stops > before, 50.0)
    robot.go_on.set()


def test_a_stop_is_not_given_up_when_it_is_lost_or_its_answer_is_late(robot, tab):
    held = []
    tab.route("**/head/stop", lambda route: held.append(route))  # noqa: PLW0108
    tab.route("**/head/stop", lambda route: route.abort(), times=1)  # the server has just ended
    before = robot.stops
    tab.locator("#stop").dispatch_event("click")
    tab.locator("#toast").wait_for()
    wait_for(lambda: tab.title() and held)
    tab.evaluate(f"({_SHOW_ABOUT})(0, true)")  # the page has heard of it otherwise
    held[0].continue_()
    wait_for(lambda: robot.stops > before, 50.0)
    tab.get_by_text("relaxed", exact=True).wait_for()


def test_a_browser_whose_connection_is_dead_says_so_and_opens_another_one(browser, page):
    is_dead = threading.Event()

    def network(near):
        """Pass messages on, until what is sent is lost, silently; only the first connection."""
        far, is_first = near.connect_to_server(), not is_dead.is_set()
        for one, other in ((near, far), (far, near)):
            one.on_message(lambda sent, to=other: (is_first and is_dead.is_set()) or to.send(sent))

    with visited(browser, page.port, network=network) as tab:
        tab.wait_for_function("window.headPage?.about && !headPage.silent")
        is_dead.set()
        tab.wait_for_function("headPage.silent")
        tab.wait_for_function("!headPage.silent")


def test_a_browser_connects_again_if_the_reason_of_a_refusal_is_late(tab):
    tab.evaluate(
        """() => {
          window.fetch = async () => ({ ok: false, text: () => Promise.reject(new Error("late")) });
          window.before = headPage.socket;
          before.close();
        }"""
    )
    tab.wait_for_function("headPage.socket !== before && headPage.socket.readyState === 1")


_SHOW_ABOUT = """(error, can_resume = false, mode = "nothing") => headPage.showAbout({
  error, word: "holding", text: "", stop: "", mode, modes: [], target_text: "",
  can_resume, stops: can_resume ? 1 : 0, images: ["/one/image", "/other/image"], frames: [],
  servos: [], movable: [], free: true, notices: [], warnings: [], failing: {}, recording: false,
  recorder: "", faults: [{ text: "overload", advice: "", command: "recover" }], can_recover: true,
  health: [{ name: "servo_bus", level: "ok", message: `${error}`, values: { load: `${error}` } }],
  calibration: { runs: false, text: "", rows: [] },
})"""


@pytest.mark.parametrize(
    "stop", ["headPage.stop()", f"({_SHOW_ABOUT})(0, true)"], ids=["here", "elsewhere"]
)
def test_stop_answers_an_open_question_with_no(tab, stop):
    tab.evaluate(
        """() => {
          headPage.tuning.ask("Can the head move freely?").then((yes) => { window.answer = yes; });
        }"""
    )
    tab.evaluate(stop)
    tab.wait_for_function("window.answer === false")


def test_during_a_replay_a_browser_sends_stop_only(robot, tab):
    asked = []
    tab.on("request", lambda request: asked.append(request.url.rpartition("/")[2]))
    robot_shown = {"name": "r", "root": "base", "independent": [], "joints": [], "shapes": []}
    replay = {"key": "1", "duration": 1.0, "moments": [], "pictures": False, "robot": robot_shown}
    tab.evaluate("opened => headPage.replay.open(opened)", replay)
    before = robot.stops
    with tab.expect_request("**/head/stop"):
        for button in ("torque-on", "centre", "reset", "recorder", "stop"):
            tab.locator(f"#{button}").dispatch_event("click")
    wait_for(lambda: robot.stops > before, 50.0)
    assert not {"torque", "centre", "reset", "record"} & set(asked)


def test_what_changes_meanwhile_takes_no_click_and_no_focus(tab):
    tab.locator("#tab-health").click()
    tab.evaluate(_SHOW_ABOUT, 1)
    tab.locator("#statuses summary").focus()
    tab.locator("#faults button").hover()
    with tab.expect_request("**/head/do/recover"):
        tab.evaluate(_SHOW_ABOUT, 2)
        assert tab.evaluate("document.activeElement.tagName") == "SUMMARY"
        tab.mouse.down()
        tab.evaluate(_SHOW_ABOUT, 3)
        tab.mouse.up()
    assert tab.locator("#statuses dd").text_content() == "3"


def test_a_command_without_the_number_of_stops_is_from_before_the_first(robot, client, monkeypatch):
    stops = []
    monkeypatch.setattr(robot.stop, "require", stops.append)
    for more in ({}, {"stops": 3}):
        client.post("/head/do/aim", json={"joints": {}} | more)
    assert stops == [0, 3]


def test_the_number_of_stops_is_known_though_the_robot_cannot_be_observed(page, tab):
    """Else a browser's commands would be carried out after a STOP that it has not heard of."""
    assert json.loads(wait_for(lambda: page._live.texts["about"]))["stops"] == 0


def test_an_empty_field_of_another_mode_does_not_keep_the_path_from_being_sent(tab):
    tab.locator("#x").evaluate("input => { input.value = ''; }")
    tab.evaluate(f"({_SHOW_ABOUT})(0, false, 'path')")
    with tab.expect_request("**/head/do/path") as asked:
        tab.locator("#go").click()
    path = {"shape": "circle", "size": 0.3, "speed": 0.2, "stops": 0}
    assert asked.value.post_data_json == path


def test_a_robot_without_a_camera_is_told_from_one_whose_picture_is_late(tab):
    show = f"""(has_camera) => {{
      ({_SHOW_ABOUT})(0);  // at once: the robot, which fails, is shown as well
      headPage.showAbout({{ ...headPage.about, has_camera }});
      return document.getElementById("nopicture").textContent;
    }}"""
    assert tab.evaluate(show, True) != tab.evaluate(show, False)


def test_the_card_of_a_frame_follows_none_until_one_is_chosen(tab):
    with tab.expect_request("**/head/do/mode") as asked:
        tab.evaluate("() => { headPage.steer.choose('follow a frame'); }")
    assert asked.value.post_data_json == {"mode": "follow a frame", "stops": 0}


def test_the_card_of_the_mode_is_in_view_on_a_phone(tab):
    tab.set_viewport_size({"width": 390, "height": 800})
    for place in ("joints", "live"):  # as after Resume on another tab
        tab.locator(f"#tab-{place}").click()
        tab.evaluate(_SHOW_ABOUT, 0)
    card = tab.locator("#cards button[aria-pressed=true]").bounding_box()
    assert 0 <= card["x"] <= 390 - card["width"]


_OLDER = """
delete AbortSignal.any;
delete AbortSignal.timeout;
HTMLCanvasElement.prototype.getContext = ((get) => function (kind, ...options) {
  return kind.startsWith("webgl") ? null : get.call(this, kind, ...options);
})(HTMLCanvasElement.prototype.getContext);
Object.defineProperty(window, "localStorage", { get() { throw new Error("denied"); } });
"""


def test_an_older_browser_without_3d_and_storage_shows_the_rest(robot, browser, page):
    with visited(browser, page.port, _OLDER) as tab:
        before = robot.stops
        tab.locator("#stop").dispatch_event("click")
        wait_for(lambda: robot.stops > before, 50.0)
        tab.locator("nav button[data-tab=joints]").dispatch_event("click")
        tab.wait_for_selector("#joints > #robot > .failing", state="attached")


def test_stop_needs_the_mark_of_the_page(robot, page):
    before = robot.stops
    assert httpx.post(f"http://127.0.0.1:{page.port}/head/stop").status_code == 403
    assert robot.stops == before


_GARBLED = """
JSON.parse = ((parse) => (text) => {
  const said = parse(text);
  const faults = [{ text: "a servo is hot", advice: "", command: "" }];
  if (said?.type === "about")
    Object.assign(said, { word: "holding", images: [], modes: null, servos: null, faults });
  return said;
})(JSON.parse);
"""


@pytest.mark.parametrize(
    ("script", "failing", "shown"),
    [
        ("", ("robot", "chart", "lookat"), "#pill[data-word=fault]"),  # in the server
        (_GARBLED, ("lookat", "health"), "#faults strong"),  # in the browser
    ],
)
def test_each_card_says_why_its_part_cannot_be_shown_and_the_rest_is(
    browser, page, script, failing, shown
):
    with visited(browser, page.port, script) as tab:
        tab.wait_for_selector(shown, state="attached")
        for card in failing:
            assert tab.locator(f"#{card} .failing").text_content()


def test_more_browsers_than_allowed_are_refused_until_one_goes(page, monkeypatch):
    wait_for(lambda: not page.browsers)
    monkeypatch.setattr(server, "_UNWATCHED", 1e3)  # s; the first one does not wait for that
    with watch(page) as first, watch(page) as second:
        until(first, "state")
        until(second, "state")
        with watch(page) as third, pytest.raises(ConnectionClosed) as refused:
            third.recv(timeout=PATIENCE)
        assert refused.value.rcvd is not None
        assert refused.value.rcvd.code == 4008
    wait_for(lambda: not page.browsers)
    with watch(page) as opened:
        until(opened, "state")


def test_a_slow_browser_is_sent_the_next_state_when_it_has_shown_the_last(page):
    """Else the answer to its STOP would wait behind all that it has no time for."""
    with watch(page) as slow, watch(page) as other:
        until(other, "state")
        slow.recv(timeout=PATIENCE)
        for _ in range(20):
            until(other, "state")
        waiting = []
        with contextlib.suppress(TimeoutError):
            while True:
                waiting.append(slow.recv(timeout=0.0))
        assert len(waiting) < 4
        slow.send("got")
        until(slow, "state")


def test_a_browser_that_sends_too_many_messages_is_refused(page):
    wait_for(lambda: not page.browsers)
    with watch(page) as flooding, watch(page) as other:
        with pytest.raises(ConnectionClosed) as refused:
            while True:
                flooding.send("got")
        assert refused.value.rcvd is not None
        assert refused.value.rcvd.code == 1008
        other.send("\0 nonsense")
        for _ in range(10):
            other.send("got")
            until(other, "state")


def test_uploads_are_limited_by_the_size_that_comes(client, monkeypatch):
    """Whether a size is declared or not."""
    monkeypatch.setattr(server, "_LARGEST_RECORDING", 1000)
    for content in (b" " * 5000, iter([b" " * 100] * 50)):
        assert client.post("/head/replay/upload", content=content).status_code == 413
    answer = client.post("/head/replay/upload", content=b"no recording")
    assert (answer.status_code, answer.json()["done"]) == (400, False)


def test_a_replay_says_why_it_shows_no_head(monkeypatch):
    recording = Recording((Observation(0),), load_robot_model(robot_file("pxxls")))
    monkeypatch.setattr("head_tracking.page.replay.read_recording", lambda _: recording)
    robot = SimpleNamespace(head_of=lambda model: (None, "another robot"))
    assert Replays(robot).open(BytesIO())["notice"] == "another robot"


@pytest.mark.parametrize("name", ["nothing.mcap", "..%2f..%2fetc%2fpasswd", "%2e%2e"])
def test_only_recordings_that_are_listed_are_sent(client, name):
    assert client.get(f"/head/recordings/{name}").status_code == 404
    assert client.post("/head/replay/open", json={"name": name}).status_code == 400


def test_a_recording_is_sent_by_its_name(robot, client, monkeypatch, tmp_path):
    file = tmp_path / "now.mcap"
    file.write_bytes(b"12345" * 100_001)
    monkeypatch.setattr(robot.recorder, "files", lambda: (file,))
    answer = client.get("/head/recordings/now.mcap")
    assert answer.content == file.read_bytes()
    assert 'filename="now.mcap"' in answer.headers["Content-Disposition"]


def test_the_page_and_three_js_are_served_from_here(client):
    """The path of three.js in NiceGUI's wheel is not a documented interface."""
    index = client.get("/").text
    imports = json.loads(index.partition('<script type="importmap">')[2].partition("</script>")[0])
    module = client.get(imports["imports"]["nicegui-scene"])
    assert all(f" as {name}" in module.text for name in ("THREE", "STLLoader"))
    assert "OrbitControls" in module.text
    assert 'font-family: "Roboto"' in client.get("/head/font/fonts.css").text
    for part in re.findall(r'(?:href|src)="(/[^"]+)"', index):
        if not part.endswith(".mcap"):
            assert client.get(part).status_code == 200, part


def test_an_address_of_another_machine_is_refused(robot):
    with pytest.raises(ParameterError):
        serve(robot, host="192.0.2.1", port=0)


def test_a_port_that_is_taken_is_left_to_who_has_it(robot, page):
    second = serve(robot, port=page.port)
    try:
        assert second.port != page.port
        assert httpx.get(f"http://127.0.0.1:{second.port}/", timeout=30.0).status_code == 200
    finally:
        second.close()
