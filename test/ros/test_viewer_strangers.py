"""What strangers publish on the topics that the page listens to: nothing of the page ends."""

import json
import random
import threading
from typing import Any

import httpx
import pytest
from contract_nodes import BusStandIn, ControllerStandIn
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, Pose, PoseArray
from random_messages import message_with
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import Image
from std_msgs.msg import Header
from viewing import until, view, watch
from waiting import PATIENCE, wait_for

from head_tracking.page.viewer import ViewerNode
from head_tracking.parameters import ParameterError
from head_tracking.ros.kit.diagnostics import Level
from head_tracking.transforms import Rotation, Transform

OTHERS = {"/tf", "/tf_static", "/clock"}
"""Topics of frames and time: they have tests of their own (test_fuzzed_messages.py)."""


@pytest.fixture
def viewer(threads):
    return view(threads)


@pytest.fixture
def stranger(viewer):
    return Node("stranger")


def told(viewer: ViewerNode) -> dict[str, Any]:
    """What a browser that comes now is told about the robot."""
    with watch(viewer.page) as browser:
        return until(browser, "about")


def diagnosed(publisher: Any, robot: Any, level: int, name: str = "camera: lens") -> Any:
    """What the page makes of a stranger's diagnostics."""
    said = DiagnosticStatus(
        level=bytes([level]), name=name, message=f"level {level}",
        values=[KeyValue(key="torque", value="n/a"), KeyValue(key="position (rad)", value="n/a")],
    )  # fmt: skip

    def heard() -> Any:
        publisher.publish(DiagnosticArray(status=[said]))
        return next((one for one in robot.topics.health() if one.message == said.message), None)

    wait_for(heard)
    return heard()


def test_a_page_that_cannot_listen_leaves_no_nodes_that_spin(threads):
    before = set(threading.enumerate())
    with pytest.raises(ParameterError, match="listen"):
        ViewerNode(parameter_overrides=[Parameter("host", value="203.0.113.1")])
    assert set(threading.enumerate()) == before


def test_no_message_ends_the_page(threads, viewer, stranger):
    """Random messages on all topics; the values are as bad as their types allow."""
    bus, rnd = BusStandIn(), random.Random(4)
    threads.start(bus)
    threads.start(ControllerStandIn("head_tracker"))
    stranger_publishers = {}
    for subscription in (*viewer.subscriptions, *viewer.robot._polled.subscriptions):
        if subscription.topic_name in OTHERS:
            continue
        publisher = stranger.create_publisher(
            subscription.msg_type, subscription.topic_name, subscription.qos_profile
        )
        stranger_publishers[subscription.topic_name] = lambda one=publisher: one.publish(
            message_with(rnd, one.msg_type)
        )
    assert len(stranger_publishers) > 10
    for _ in range(100):
        for publish in stranger_publishers.values():
            publish()
        viewer.robot.observe()
        viewer.robot.notices()
        viewer.robot.status(viewer.robot.observe())
    assert threads.failure is None
    publisher = stranger.create_publisher(DiagnosticArray, "/diagnostics", 10)
    assert diagnosed(publisher, viewer.robot, 1, "").name == "unnamed"
    assert told(viewer)
    assert viewer.robot.stop_everything().wait(PATIENCE).done
    assert "stop" in bus.calls


def test_pictures_that_cannot_be_shown_are_named(viewer, stranger):
    publishers = {
        name: stranger.create_publisher(Image, f"/{name}/image", 1) for name in ("bad", "good")
    }
    good = Image(encoding="mono8", width=2, height=2, step=2, data=[0] * 4)
    viewer.page._live.sample()
    with watch(viewer.page) as first:
        first.send("camera /good/image")

        def shown():
            publishers["bad"].publish(Image(encoding="nonsense", width=2, height=2, step=2))
            publishers["good"].publish(good)
            pictures, failing = viewer.page._live.pictures, told(viewer)["failing"]
            return "/good/image" in pictures and "/good" not in failing.get("picture", "/good")

        wait_for(shown)


def test_the_default_picture_stays_until_the_robots_own_camera_starts(viewer, stranger):
    image = Image(encoding="mono8", width=2, height=2, step=2, data=[0] * 4)

    def default(*names):
        publishers = [stranger.create_publisher(Image, name, 1) for name in names]

        def shown():
            for publisher in publishers:
                publisher.publish(image)
            viewer.robot.observe()
            live = viewer.page._live
            return len(viewer.robot.topics.images()) == len(names) and live.latest_picture()

        return wait_for(shown).topic

    assert default("/camera/image") == "/camera/image"
    assert default("/camera/image", "/another/image") == "/camera/image"
    assert default("/camera/image", "/another/image", "/image") == "/image"


def test_what_else_a_camera_sees_is_finite_and_of_its_frame(viewer, stranger):
    topics = viewer.robot.topics
    publisher = stranger.create_publisher(PoseArray, "/visual_target/others", 10)
    poses = [Pose(position=Point(x=x, z=2.0)) for x in (float("nan"), 0.5, float("inf"))]
    message = PoseArray(header=Header(frame_id="lens"), poses=poses)

    def seen():
        publisher.publish(message)
        viewer.robot.observe()
        return topics.others("lens")

    wait_for(seen)
    assert [one.point for one in seen()] == [(0.5, 0.0, 2.0)]
    assert topics.others("another") == ()


def test_a_parameter_that_becomes_something_else_hides_no_other(threads, viewer):
    node = Node("stranger")
    anything = ParameterDescriptor(dynamic_typing=True)
    node.declare_parameter("gains", [1.0, 2.0], anything)
    node.declare_parameter("serial_number", Parameter.Type.STRING)  # without a value
    node.declare_parameter("gain", 1.0)
    threads.start(node)

    def listed():
        answer = httpx.get(f"http://127.0.0.1:{viewer.page.port}/head/parameters", timeout=PATIENCE)
        return {one["name"] for one in answer.json()["parameters"]}

    wait_for(lambda: {"gains", "gain"} <= listed())
    node.set_parameters([Parameter("gains", value=["a", "b"])])
    wait_for(lambda: listed() & {"gains", "gain"} == {"gain"})


def test_a_flood_of_frames_is_limited(viewer):
    place = Transform((1.0, 0.0, 1.0), Rotation.identity())
    viewer.robot.buffer.set_transform(0, "base_link", "a wall", place, static=True)
    for number in range(1000):
        viewer.robot.buffer.set_transform(10**9, "base_link", f"flood_{number}", place)
    offered = set(told(viewer)["frames"])
    assert "a wall" in offered
    assert 100 < len(offered) < 400


def test_diagnostics_of_what_has_gone_are_left_out_and_of_what_hangs_are_stale(viewer):
    nodes = {name: Node(name) for name in ("gone", "hanging", "arm")}
    publishers = {
        name: node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        for name, node in nodes.items()
    }
    for name, publisher in publishers.items():
        assert diagnosed(publisher, viewer.robot, 0, f"{name}: first").level is Level.OK
    nodes.pop("gone").destroy_node()

    def levels():
        other = DiagnosticStatus(name="arm: second", level=DiagnosticStatus.OK)
        publishers["arm"].publish(DiagnosticArray(status=[other]))
        return {one.name: one.level for one in viewer.robot.topics.health()}

    wait_for(lambda: levels() == {"hanging: first": Level.STALE, "arm: second": Level.OK})


def test_a_flood_of_diagnostics_is_limited_and_hides_no_servo(threads, viewer, stranger):
    threads.start(BusStandIn())
    publisher = stranger.create_publisher(DiagnosticArray, "/diagnostics", 10)
    wait_for(lambda: "servo_bus" in viewer.robot.graph.nodes)
    pairs = [KeyValue(key=f"{number}", value="y" * 2000) for number in range(400)]
    first = DiagnosticStatus(name="stranger: 0", message="x" * 10**5, values=pairs)
    parts = [DiagnosticStatus(name=f"stranger: {number}") for number in range(1, 600)]
    nodes = [DiagnosticStatus(name=f"node_{number}: part") for number in range(600)]

    def health():
        publisher.publish(DiagnosticArray(status=[first, *parts, *nodes]))
        return {one.name: one for one in viewer.robot.topics.health()}

    wait_for(lambda: {"servo_bus: head_pan_joint", "stranger: 0"} <= health().keys())
    found = health()
    assert len(found) < 300
    assert len(found["stranger: 0"].message) < 2000
    assert len(found["stranger: 0"].values) < 300
    assert len(json.dumps(told(viewer))) < 10**6


def test_diagnostics_of_a_stranger_that_name_a_servo_hide_nothing_of_it(threads, viewer, stranger):
    threads.start(BusStandIn())
    publisher = stranger.create_publisher(DiagnosticArray, "/diagnostics", 10)
    pairs = {"controller": "head_pan_controller", "joint": "head_pan_joint", "temperature": "hot"}
    claim = DiagnosticStatus(
        name="stranger: head_pan_joint",
        values=[KeyValue(key=key, value=value) for key, value in pairs.items()],
    )

    def servos():
        publisher.publish(DiagnosticArray(status=[claim]))
        names = [one.name for one in viewer.robot.topics.health()]
        found = viewer.robot.joints.servos()
        return found if claim.name in names and len(found) == 2 else None

    for servo in wait_for(servos):
        assert servo.values["torque"] == "torque on"
        assert servo.torque


WRONG = [
    ("nonsense", b"{}", 404),
    ("mode", b"\xff", 400),
    ("mode", b"[" * 60_000, 400),
    ("mode", b'{"mode": "dance"}', 400),
    ("look", b'{"u": 0.5, "v": 0.5, "stamp": 1e400}', 400),
    ("look", b'{"point": [1, 2]}', 400),
    ("look", b'{"point": [1, 2, NaN]}', 400),
    ("aim", b'{"joints": {}}', 400),
    ("aim", b'{"joints": {"a": NaN}}', 400),
    ("aim", b" " * 70_000, 413),
    ("select", b'{"frame_id": "base_link", "stamp": "1e9", "point": [1, 2, 3]}', 400),
    (
        "select",
        b'{"frame_id": "base_link", "stamp": "9999999999999999999", "point": [1, 2, 3]}',
        400,
    ),
    ("record", b'{"on": 1}', 400),
    ("torque", b'{"on": null}', 400),
]


def test_a_request_with_wrong_fields_is_refused(viewer):
    address = f"http://127.0.0.1:{viewer.page.port}/head/do/"
    for command, body, status in WRONG:
        headers = {"X-Head-Tracking": "page"}
        answer = httpx.post(address + command, content=body, headers=headers, timeout=PATIENCE)
        assert answer.status_code == status, (command, body)
