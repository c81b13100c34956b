"""The page on a robot that is not there: what it sends, and that it does not grow."""

import gzip
import http.client
import io
import json
import math
import threading
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any
from urllib.parse import quote

import numpy as np
import pytest
from PIL import Image
from viewer_client import ReadingClient
from websockets.exceptions import InvalidStatus

from head_tracking.gaze import PanTiltHead
from head_tracking.recording.recording import Observation, Recording
from head_tracking.recording.recording_file import read_recording, write_recording
from head_tracking.ros.kit.diagnostics import Health, Level
from head_tracking.ros.kit.other_parameters import Setting
from head_tracking.ros.kit.other_services import Hold, Outcome
from head_tracking.transforms import RobotModel, Rotation, Transform, parse_robot_model
from head_tracking.viewer.badge import Badge, Word
from head_tracking.viewer.gaze_scene import ViewParameters
from head_tracking.viewer.head_modes import Mode
from head_tracking.viewer.joint_control import Servo
from head_tracking.viewer.other_topics import Picture
from head_tracking.viewer.page import Page, PageParameters

PATIENCE = 60.0


class FakeRobot:
    """A robot that moves all its joints all the time, and remembers what it was asked."""

    def __init__(self, model: RobotModel) -> None:
        self._model = model
        try:
            self._head: Any = PanTiltHead(model, "head_pan_joint", "head_tilt_joint", "camera_link")
        except Exception:
            self._head = None
        self.seen = 0
        self.asked: list[Any] = []
        self.broken = False
        self.buffer = SimpleNamespace(frames=self._frames)
        self.parameters = SimpleNamespace(settings=self._settings)
        self.hold = Hold()
        self.recorder = SimpleNamespace(file=None, status="", files=tuple, directory="nowhere")
        self.stop = SimpleNamespace(outcome=None, can_resume=False, cancel=lambda: None)
        self.modes = SimpleNamespace(
            mode=lambda: Mode.TRACK,
            possible=lambda: tuple(Mode),
            can_start=lambda _: False,
            look_at=self._look_at,
            path=None,
            set_path=lambda *_: None,
        )
        self.joints = SimpleNamespace(
            free=False,
            can_recover=False,
            servos=lambda: (Servo("head_pan_controller", "head_pan_joint", self.seen % 20 > 10),),
        )
        self.topics = SimpleNamespace(
            images=tuple,
            picture=lambda _: None,
            warnings=lambda: tuple(f"warning {number}" for number in range(self.seen % 7)),
        )

    def model(self) -> RobotModel:
        return self._model

    def head(self) -> Any:
        return self._head

    def observe(self) -> Observation:
        self.seen += 1
        if self.broken:
            raise RuntimeError("the robot is broken")
        t = 0.04 * self.seen
        return Observation(
            1 + round(t * 1e9),
            dict.fromkeys(self._model.independent_joints, 0.5 * math.sin(t)),
            {"other": Transform((math.sin(t), 1.0, 0.5), Rotation.identity())},
            (1.0, math.sin(t), 0.5),
            "somewhere",
            abs(0.01 * math.sin(t)),
            f"tracking for {t:.2f} s",
        )

    def notices(self) -> tuple[str, ...]:
        return ()

    def badge(self, live: Observation) -> Badge:
        return Badge(Word.MOVING, f"message {self.seen}")

    def health(self) -> tuple[Health, ...]:
        level = Level.ERROR if self.seen % 40 > 20 else Level.OK
        return (Health("servo_bus: pan", level, f"message {self.seen}", {"torque": "on"}),)

    def stop_everything(self) -> Outcome:
        self.asked.append("stop")
        return Outcome(True, "head_pan_joint relaxed")

    def _frames(self) -> tuple[str, ...]:
        # one comes and goes
        return (*self._model.links, "other", *(["late"] if self.seen % 100 > 50 else []))

    def _settings(self) -> tuple[Setting, ...]:
        k = Setting("/head_tracker", "k_pan", 1.0 + self.seen % 10, "Speed per error.", 0.1, 20.0)
        extra = Setting("/late", "center", [0.0, 0.0, 0.1 * (self.seen % 5)], "", -1e3, 1e3)
        return (k, extra) if self.seen % 80 > 40 else (k,)

    def _look_at(self, *arguments: Any, **_: Any) -> Outcome:
        self.asked.append(("look_at", *arguments))
        return Outcome(True, "done")


def long_arm(links: int) -> RobotModel:
    """A chain of so many links that all turn."""
    parts = ['<robot name="arm"><link name="l0"/>']
    for number in range(1, links):
        parts.append(
            f'<link name="l{number}"><visual><geometry><box size="0.02 0.02 0.05"/></geometry>'
            f'</visual></link><joint name="j{number}" type="revolute">'
            f'<parent link="l{number - 1}"/>'
            f'<child link="l{number}"/><origin xyz="0 0 0.05"/><axis xyz="1 0 0"/>'
            '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        )
    return parse_robot_model("".join([*parts, "</robot>"]))


@pytest.fixture
def show(monkeypatch) -> Iterator[Callable[[FakeRobot], Page]]:
    monkeypatch.setattr("head_tracking.viewer.page._SLOW", 0.01)
    pages: list[Page] = []

    def open_page(robot: FakeRobot, complaints: list[str] | None = None, **given: Any) -> Page:
        said: list[str] = [] if complaints is None else complaints
        parameters = PageParameters(rate=1000.0, **given)  # a minute's work in seconds
        page = Page(robot, parameters, ViewParameters(), lambda _: None, said.append)
        pages.append(page)
        return page

    yield open_page
    for page in pages:
        page.close()


def wait_for(what: Callable[[], Any]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not what():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def messages(page: Page) -> int:
    """How many messages a browser that comes now would be sent."""
    return len(page._server._websock_server._broadcast_buffer.message_from_id)


def test_a_page_left_open_does_not_grow(kinectbot, show):
    complaints: list[str] = []
    robot = FakeRobot(kinectbot)
    page = show(robot, complaints)
    client = ReadingClient(page.port)
    try:
        wait_for(lambda: page.browsers == 1)
        wait_for(lambda: robot.seen > 150)
        most = 0
        while robot.seen < 400:
            most = max(most, messages(page))
            time.sleep(0.01)
        later = 0
        while robot.seen < 650:
            later = max(later, messages(page))
            time.sleep(0.01)
    finally:
        client.close()
    assert client.received > 100_000
    # nodes and inputs that come and go leave a mark until the next browser comes
    assert later < most + 40
    assert not complaints


def test_browsers_that_come_and_go_leave_nothing_behind(kinectbot, show):
    robot = FakeRobot(kinectbot)
    page = show(robot)

    def visit() -> None:
        client = ReadingClient(page.port)
        wait_for(lambda: page.browsers == 1)
        wait_for(lambda: client.received > 10_000)
        client.close()
        wait_for(lambda: page.browsers == 0)

    visit()
    threads = threading.active_count()
    for _ in range(15):
        visit()
    assert threading.active_count() <= threads + 32  # viser's pool grows to 32 and stays


def test_a_robot_with_60_links_is_one_message_a_joint(show):
    robot = FakeRobot(long_arm(60))
    page = show(robot)
    client = ReadingClient(page.port, keep=True)
    try:
        wait_for(lambda: client.named("SetPositionMessage", "/target"))
        client.messages.clear()
        wait_for(lambda: len(client.named("SetPositionMessage", "/target")) > 50)
        messages = list(client.messages)
    finally:
        client.close()
    moves = [m["name"] for m in messages if m["type"] == "SetOrientationMessage"]
    assert len(set(moves)) == 59
    states = len([m for m in messages if m.get("name") == "/target"])
    assert len(moves) <= 59 * (states + 1)
    places = {m["name"] for m in messages if m["type"] == "SetPositionMessage"}
    assert places == {"/target", "/gizmo"}  # joints that turn are not moved too


def test_everything_can_be_drawn_and_taken_away_again(kinectbot, show):
    complaints: list[str] = []
    robot = FakeRobot(kinectbot)
    page = show(robot, complaints)
    client = ReadingClient(page.port)
    scene = page._server.scene

    def label() -> Any:
        return scene.get_handle_by_name(f"{page._scene.path('torso_link')}/label")

    try:
        wait_for(lambda: page._views._parts and "other" in page._views._frames.options)
        page._views._frames.value = "all frames"
        wait_for(lambda: label() and scene.get_handle_by_name("/frames/other"))
        page._views._frames.value = "none"
        wait_for(lambda: label() is None and scene.get_handle_by_name("/frames/other") is None)
        for part in ("target", "trail", "prediction", "line of sight", "reachable field"):
            page._gaze.want(part, not page._gaze.wanted(part))
        seen = robot.seen
        wait_for(lambda: robot.seen > seen + 20)
        assert not page._gaze._target.visible
        assert page._gaze._of_head["reachable field"].visible
    finally:
        client.close()
    assert not complaints


def test_another_model_takes_the_place_of_the_first(kinectbot, turtlebot, show):
    complaints: list[str] = []
    robot = FakeRobot(kinectbot)
    page = show(robot, complaints)
    client = ReadingClient(page.port)
    try:
        wait_for(lambda: page.browsers and page._scene is not None)
        robot._head, robot._model = None, turtlebot
        wait_for(lambda: page._scene.model is turtlebot)
        robot._head = PanTiltHead(turtlebot, "head_pan_joint", "head_tilt_joint", "camera_link")
        wait_for(lambda: page._head is robot._head)
        wait_for(lambda: "left_wheel_joint" in page._joints._sliders)
    finally:
        client.close()
    assert page._server.scene.get_handle_by_name(f"{page._scene.path('plate_3_link')}") is not None
    assert not complaints


def test_the_banner_comes_and_goes_with_the_trouble(kinectbot, show):
    robot = FakeRobot(kinectbot)
    page = show(robot)
    client = ReadingClient(page.port)
    try:
        wait_for(lambda: page._status._banner.visible)
        assert "pan: message" in page._status._banner.content
        wait_for(lambda: not page._status._banner.visible)
    finally:
        client.close()


def test_the_gizmo_sends_where_it_is_dragged_to(kinectbot, show):
    robot = FakeRobot(kinectbot)
    page = show(robot)
    wait_for(lambda: page._steering._root)
    page._steering._gizmo.position = (1.0, 0.5, 0.25)
    for phase in ("start", "update", "update", "end"):
        page._steering._on_drag(SimpleNamespace(phase=phase))
    # those that come too fast are left out; where it is dropped is always sent
    assert robot.asked == [("look_at", "base_link", (1.0, 0.5, 0.25))] * 2


def test_a_browser_can_look_through_the_camera_and_back(kinectbot, show):
    robot = FakeRobot(kinectbot)
    page = show(robot)
    client = ReadingClient(page.port)
    try:
        wait_for(lambda: page.browsers and page._views._camera._camera)
        (browser,) = page._server.get_clients().values()
        own = browser.camera.position
        view = page._views._camera
        view._on_click(SimpleNamespace(client=browser))
        wait_for(lambda: math.dist(browser.camera.position[:2], (0.0, 0.0)) < 0.3)  # over the robot
        x, y, z, w = browser.camera.wxyz[[1, 2, 3, 0]]
        positions = robot.observe().joints
        view._on_click(SimpleNamespace(client=browser))
        assert browser.camera.position == pytest.approx(own)
        assert positions["head_pan_joint"] != 0.0
        looks_along = Rotation(x, y, z, w) @ (0.0, 0.0, 1.0)
        assert looks_along[0] > 0.5  # ahead, give or take half a radian of pan and tilt
    finally:
        client.close()


def test_a_recording_is_shown_in_place_of_the_robot(kinectbot, show):
    robot = FakeRobot(kinectbot)
    page = show(robot)
    wait_for(lambda: len(page._last_minute._seen) > 60)
    panel = page._recording
    nobody = SimpleNamespace(client=None)
    panel._open(nobody, lambda: read_recording(io.BytesIO(write_recording(panel._seen_now()))))
    start = panel.replayed()
    assert robot.hold.reason
    panel._go(panel._recording.duration)
    assert panel.replayed().stamp > start.stamp
    panel._toggle()  # plays from the start again, and pauses there
    panel._toggle()
    assert panel.replayed().stamp < start.stamp + 10**9
    panel.close()
    assert panel.replayed() is None
    assert not robot.hold.reason
    panel._open(nobody, lambda: read_recording(io.BytesIO(b"no recording")))
    assert panel.replayed() is None


def test_a_browser_gets_recordings_and_no_other_files(kinectbot, show, tmp_path):
    folder = tmp_path / "recordings"
    folder.mkdir()
    (tmp_path / "secret.mcap").write_bytes(b"secret")
    file = folder / "head.mcap"
    file.write_bytes(b"recorded")
    robot = FakeRobot(kinectbot)
    robot.recorder = SimpleNamespace(
        file=None, status="", directory=folder, files=lambda: (folder / "head.mcap",)
    )
    panel = show(robot)._recording
    sent: list[Any] = []
    client = SimpleNamespace(
        send_file_download=lambda name, content, **_: sent.append((name, content)),
        add_notification=lambda *arguments, **_: sent.append(arguments),
    )
    for name in ("head.mcap", "../secret.mcap", str(tmp_path / "secret.mcap"), ""):
        panel._file = SimpleNamespace(value=name, options=())
        panel._on_download(SimpleNamespace(client=client))
    assert sent[0] == ("head.mcap", b"recorded")
    assert all("no such recording" in text for _, text in sent[1:])
    assert len(sent) == 4


def test_the_recording_of_another_robot_is_shown_on_its_own_model(kinectbot, turtlebot, show):
    complaints: list[str] = []
    robot = FakeRobot(kinectbot)
    page = show(robot, complaints)
    client = ReadingClient(page.port)
    other = Recording((Observation(1, {"left_wheel_joint": 0.5}),), turtlebot.urdf)
    try:
        wait_for(lambda: page._scene is not None)
        page._recording._open(SimpleNamespace(client=None), lambda: other)
        wait_for(lambda: page._scene.model.name == "turtlebot")
        seen = robot.seen
        wait_for(lambda: robot.seen > seen + 5)
        assert page._stop({}) == {"text": "head_pan_joint relaxed"}  # and shows the robot again
        wait_for(lambda: page._scene.model is kinectbot)
    finally:
        client.close()
    assert not complaints


def test_without_a_browser_nothing_is_drawn(kinectbot, show):
    robot = FakeRobot(kinectbot)
    page = show(robot)
    wait_for(lambda: robot.seen > 50)
    before = messages(page)
    wait_for(lambda: robot.seen > 150)
    assert messages(page) == before


def test_the_page_outlives_what_goes_wrong(kinectbot, show):
    complaints: list[str] = []
    robot = FakeRobot(kinectbot)
    robot.broken = True
    show(robot, complaints)
    wait_for(lambda: complaints)
    assert "the robot is broken" in complaints[0]
    robot.broken = False
    wait_for(lambda: robot.seen > 60)


def test_a_part_that_fails_is_named_and_the_others_go_on(kinectbot, show):
    complaints: list[str] = []
    robot = FakeRobot(kinectbot)
    servo = {"torque": "torque on", "position (rad)": "n/a"}
    robot.health = lambda: (Health("servo_bus: pan", Level.OK, "fine", servo),)
    robot.modes.possible = lambda: 1 // 0
    page = show(robot, complaints)
    client = ReadingClient(page.port)
    try:
        wait_for(lambda: "ZeroDivisionError" in page._status._messages.content)
        assert "<td>n/a</td>" in page._status._bus.content
        values = set()  # a panel after the one that fails
        wait_for(
            lambda: (
                values.add(page._tuning._inputs["/head_tracker", "k_pan"].value) or len(values) > 2
            )
        )
        robot.modes.possible = lambda: tuple(Mode)
        wait_for(lambda: "ZeroDivisionError" not in page._status._messages.content)
    finally:
        client.close()
    assert len(complaints) == 1


def test_the_page_listens_on_this_machine_only(kinectbot, show):
    page = show(FakeRobot(kinectbot))
    assert page._server.get_host() == "127.0.0.1"


@pytest.mark.parametrize("host", ["192.0.2.1", "nowhere.invalid"])
def test_an_address_of_another_machine_is_refused(kinectbot, host):
    with pytest.raises(ValueError, match="can't listen on"):
        Page(
            FakeRobot(kinectbot),
            PageParameters(host=host),
            ViewParameters(),
            lambda _: None,
            print,
        )


def test_nobody_can_open_a_tunnel_to_the_world(kinectbot, show):
    assert show(FakeRobot(kinectbot))._server.request_share_url() is None


def get(page: Page, path: str, **headers: str) -> tuple[int, Any, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=30)
    try:
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.headers, answer.read()
    finally:
        connection.close()


PAGE = {"X-Head-Tracking": "page"}


def test_stop_is_answered_beside_viser_and_only_to_the_page_itself(kinectbot, show):
    robot = FakeRobot(kinectbot)
    page = show(robot)
    status, _, _ = get(page, "/head/stop")
    assert status == 403  # an image on a page of another site would ask like this
    assert robot.asked == []
    status, _, body = get(page, "/head/stop", **PAGE)
    assert (status, json.loads(body)) == (200, {"text": "head_pan_joint relaxed"})
    assert robot.asked == ["stop"]


def test_stop_is_answered_while_everything_that_viser_calls_back_hangs(kinectbot, show):
    robot = FakeRobot(kinectbot)
    page = show(robot)
    hanging = threading.Event()
    try:
        for _ in range(200):
            page._server.gui._thread_executor.submit(hanging.wait, 30.0)
        status, _, _ = get(page, "/head/stop", **PAGE)
        assert status == 200
        assert robot.asked == ["stop"]
    finally:
        hanging.set()


def test_the_badge_is_told_and_says_when_a_recording_is_shown(kinectbot, show):
    robot = FakeRobot(kinectbot)
    page = show(robot)

    def status() -> Any:
        return json.loads(get(page, "/head/status", **PAGE)[2])

    assert status()["word"] == "moving"
    assert status()["title"] == "kinectbot"
    wait_for(lambda: len(page._last_minute._seen) > 10)
    page._recording._open(SimpleNamespace(client=None), page._last_minute.recording)
    assert status()["word"] == "replay"
    assert "the robot: moving" in status()["text"]
    page._recording.close()
    assert status()["word"] == "moving"


def test_the_newest_picture_is_handed_out_once_and_a_click_in_it_turns_the_head(kinectbot, show):
    robot = FakeRobot(kinectbot)
    pixels = np.full((240, 640, 3), (250, 120, 10), np.uint8)
    seen = Picture(7, 10**9, "camera_optical_frame", pixels, None)
    robot.topics.images = lambda: ("/depth", "/image", "/visual_target/image")
    asked: list[str] = []
    robot.topics.picture = lambda topic: (asked.append(topic), seen)[1]
    robot.buffer.lookup_transform = lambda *_: SimpleNamespace(
        transform=Transform((0.0, 0.0, 0.5), Rotation.from_rpy(-math.pi / 2, 0.0, -math.pi / 2))
    )
    page = show(robot)
    client = ReadingClient(page.port)
    try:
        wait_for(lambda: page._picture.chosen == "/visual_target/image")  # what was found is in it
        robot.seen = 0
        wait_for(lambda: robot.seen > 50)
        assert not asked, "nobody looks at the page"
        assert json.loads(get(page, "/head/status?looks", **PAGE)[2])["picture"]
        wait_for(lambda: asked)
        assert json.loads(get(page, "/head/status", **PAGE)[2])["legend"][0][0] == "target"
    finally:
        client.close()
    status, headers, body = get(page, "/head/picture?after=&took=100", **PAGE)
    assert (status, headers["Content-Type"], headers["X-Stamp"]) == (200, "image/jpeg", str(10**9))
    shown = np.asarray(Image.open(io.BytesIO(body)))
    assert shown.shape == (120, 320, 3)
    assert shown.mean(axis=(0, 1)) == pytest.approx((250, 120, 10), abs=4)
    assert get(page, f"/head/picture?after={headers['X-Number']}", **PAGE)[0] == 204
    robot.asked.clear()
    for query in ("u=0.5&v=0.5&stamp=1000000000", "u=1&v=0.5&stamp=1000000000"):
        assert json.loads(get(page, f"/head/look?{query}", **PAGE)[2])["done"]
    (_, frame, ahead), (_, _, right) = robot.asked
    assert frame == "base_link"
    assert ahead[0] > 0.5
    assert ahead[1:] == pytest.approx((0.0, 0.5), abs=1e-6)
    assert math.atan2(-right[1], right[0]) == pytest.approx(0.5, abs=0.01)
    refused = json.loads(get(page, "/head/look?u=one&v=0.5&stamp=1", **PAGE)[2])
    assert not refused["done"]
    assert len(robot.asked) == 2


def test_browsers_see_all_of_it_until_a_person_moves_their_eye(kinectbot, show):
    robot = FakeRobot(kinectbot)
    page = show(robot)
    client = ReadingClient(page.port)
    try:
        wait_for(lambda: page._framing._placed)
        (browser,) = page._server.get_clients().values()
        first = tuple(browser.camera.position)
        browser.camera.position = (5.0, 5.0, 5.0)
        wait_for(lambda: page._framing._moved)
        seen = robot.seen
        wait_for(lambda: robot.seen > seen + 20)
        assert tuple(browser.camera.position) == (5.0, 5.0, 5.0)
        assert math.dist(first, (0.0, 0.0, 0.3)) < 3.0
    finally:
        client.close()
    wait_for(lambda: not page._framing._placed)


def test_no_other_page_can_put_this_one_into_a_frame(kinectbot, show):
    page = show(FakeRobot(kinectbot))
    for path in ("/", "/head/bar.js", "/nowhere"):
        _, headers, _ = get(page, path)
        assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    for encoding in ("identity", "gzip"):
        _, headers, body = get(page, "/", **{"Accept-Encoding": encoding})
        text = gzip.decompress(body) if encoding == "gzip" else body
        assert b'<script src="head/bar.js"></script></head>' in text


def test_who_comes_when_it_is_full_is_told_so_at_the_door(kinectbot, show):
    page = show(FakeRobot(kinectbot), max_browsers=1)
    client = ReadingClient(page.port)
    try:
        wait_for(lambda: page.browsers == 1)
        status, _, body = get(page, "/")
        assert status == 503
        assert b"1 browsers watch this robot already" in body
        with pytest.raises(InvalidStatus) as refused:
            ReadingClient(page.port)
        assert refused.value.response.status_code == 503
        assert get(page, "/head/stop", **PAGE)[0] == 200  # for everybody who could load the page
    finally:
        client.close()
    wait_for(lambda: get(page, "/")[0] == 200)


def test_beyond_this_machine_a_token_is_asked_for(kinectbot, show):
    page = show(FakeRobot(kinectbot), host="0.0.0.0")
    assert get(page, "/")[0] == 403
    assert get(page, "/head/stop", **PAGE)[0] == 403
    # a site whose name points here, and which has no cookie of this page
    rebound = {"Host": "elsewhere.example", "Origin": "http://elsewhere.example"}
    assert get(page, "/", **rebound)[0] == 403
    assert get(page, "/?token=guessed")[0] == 403
    status, headers, _ = get(page, f"/?token={page.token}")
    assert status == 200
    cookie = headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert get(page, "/head/stop", **PAGE, Cookie=cookie.partition(";")[0])[0] == 200
    with pytest.raises(InvalidStatus):
        ReadingClient(page.port)


def test_two_pages_of_one_host_keep_a_browser_each(kinectbot, show):
    tokens = ("one", "two", "a;b c")
    pages = [show(FakeRobot(kinectbot), host="0.0.0.0", token=token) for token in tokens]
    jar = {"another": '{"of": "another program"}'}  # a browser's: by host and name
    for page in pages:
        status, headers, _ = get(page, f"/?token={quote(page.token)}")
        assert status == 200
        name, _, value = headers["Set-Cookie"].partition(";")[0].partition("=")
        jar[name] = value
    cookies = "; ".join(f"{name}={value}" for name, value in jar.items())
    for page in pages:
        assert get(page, "/head/stop", **PAGE, Cookie=cookies)[0] == 200


def test_only_who_uploads_a_file_is_told_how_that_goes(kinectbot, show):
    page = show(FakeRobot(kinectbot))
    one, other = ReadingClient(page.port, keep=True), ReadingClient(page.port, keep=True)
    try:
        wait_for(lambda: page.browsers == 2)
        (button,) = [
            uuid
            for uuid, handle in page._server.gui._gui_input_handle_from_uuid.items()
            if type(handle).__name__ == "GuiUploadButtonHandle"
        ]
        start = {
            "type": "FileTransferStartUpload",
            "source_component_uuid": button,
            "transfer_uuid": "upload",
            "filename": "head.mcap",
            "mime_type": "",
            "part_count": 2,
            "size_bytes": 8,
        }
        part = {
            "type": "FileTransferPart",
            "source_component_uuid": button,
            "transfer_uuid": "upload",
            "part_index": 0,
            "content": b"1234",
        }

        def told(client: ReadingClient) -> bool:
            return any(one["type"] == "FileTransferPartAck" for one in list(client.messages))

        one.send(start)
        one.send(part)
        wait_for(lambda: told(one))
        seen = len(other.messages)
        wait_for(lambda: len(other.messages) > seen + 20)
        assert not told(other)
    finally:
        one.close()
        other.close()


def test_each_browser_has_a_point_of_its_own(kinectbot, show):
    robot = FakeRobot(kinectbot)
    page = show(robot)
    browsers = [ReadingClient(page.port, keep=True) for _ in range(2)]

    def made(browser: ReadingClient, kind: str, label: str) -> list[str]:
        return [
            message["uuid"]
            for message in list(browser.messages)
            if message["type"] == kind and message["props"]["label"] == label
        ]

    def update(browser: ReadingClient, kind: str, label: str, value: Any) -> None:
        (uuid,) = made(browser, kind, label)
        browser.send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}})

    button = "GuiButtonMessage", "Point head"
    try:
        wait_for(lambda: all(made(browser, *button) for browser in browsers))
        update(browsers[0], "GuiVector3Message", "x y z (m)", [1.0, 2.0, 3.0])
        for number, point in ((0, (1.0, 2.0, 3.0)), (1, (1.0, 0.0, 0.0))):
            robot.asked.clear()
            update(browsers[number], *button, True)
            wait_for(lambda: robot.asked)
            assert robot.asked[0][2] == point
        browsers[0].close()
        wait_for(lambda: page.browsers == 1)
        wait_for(lambda: len(page._steering._inputs) == 1)
    finally:
        for browser in browsers:
            browser.close()


def test_a_limit_is_shown_as_it_is_while_a_browser_asks_and_after_it_has_gone(kinectbot, show):
    robot = FakeRobot(kinectbot)
    limit = Setting("/servo_bus", "head_pan_controller.motor.max", 1023, "", -math.inf, math.inf)
    robot.parameters.settings = lambda: (limit,)
    page = show(robot)
    one, other = ReadingClient(page.port, keep=True), ReadingClient(page.port, keep=True)
    try:
        wait_for(lambda: page.browsers == 2 and page._tuning._inputs)
        ((_, field),) = page._tuning._inputs.items()
        one.send({"type": "GuiUpdateMessage", "uuid": field._impl.uuid, "updates": {"value": 900}})
        wait_for(lambda: any("Modal" in message["type"] for message in list(one.messages)))
        one.close()

        def shown() -> list[Any]:
            return [
                message["updates"]["value"]
                for message in list(other.messages)
                if message["type"] == "GuiUpdateMessage"
                and message["uuid"] == field._impl.uuid
                and "value" in message["updates"]
            ]

        wait_for(lambda: shown() and shown()[-1] == 1023)
    finally:
        one.close()
        other.close()


def test_a_file_that_is_too_large_is_refused_before_it_is_held_in_memory(kinectbot, show):
    page = show(FakeRobot(kinectbot))
    client = ReadingClient(page.port, keep=True)
    try:
        (button,) = [
            uuid
            for uuid, handle in page._server.gui._gui_input_handle_from_uuid.items()
            if type(handle).__name__ == "GuiUploadButtonHandle"
        ]

        def upload(size: int, transfer: str) -> None:
            client.send(
                {
                    "type": "FileTransferStartUpload",
                    "source_component_uuid": button,
                    "transfer_uuid": transfer,
                    "filename": "large.mcap",
                    "mime_type": "",
                    "part_count": 600,
                    "size_bytes": size,
                }
            )

        def refusals() -> int:
            return sum("too large" in str(one) for one in list(client.messages))

        upload(1_000_000, "small")
        states = page._server.gui._current_file_upload_states
        wait_for(lambda: "small" in states)
        upload(300_000_000, "large")
        wait_for(lambda: refusals() == 1)
        assert "large" not in states
        upload(1_000_000, "also small")
        for number in range(5):  # more than was said
            transfer = ("small", "also small")[number % 2]
            part = {
                "type": "FileTransferPart",
                "source_component_uuid": button,
                "transfer_uuid": transfer,
                "part_index": number,
                "content": bytes(15_000_000),
            }
            client.send(part)
        wait_for(lambda: refusals() == 2)
        assert len(states) == 1
    finally:
        client.close()
