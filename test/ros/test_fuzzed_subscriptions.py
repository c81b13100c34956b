"""Whatever comes in on a topic of transforms or joints: nothing dies, and the reason is said."""

import math
import random
from types import SimpleNamespace

import pytest
import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from head_tracking.ros.robot.joint_state_publisher import JointStatePublisherNode
from head_tracking.ros.robot.robot_state_publisher import RobotStatePublisherNode
from head_tracking.share import robot_file
from head_tracking.tf import Buffer, TransformException, TransformListener
from head_tracking.transforms import load_robot_model

NUMBERS = (0.0, 1.0, -0.5, 1e-320, 1e12, 1e308, -1.7e308, math.nan, math.inf, -math.inf)
FRAMES = ("", "/", "a", "/a", "b", "base_link", "camera_link", "//", "ä b", "x" * 300)
JOINTS = ("", "head_pan_joint", "head_tilt_joint", "head_pan_joint", "left_wheel_joint", "?")


class Said:
    """A logger that keeps what it is told."""

    def __init__(self) -> None:
        self.errors: list[str] = []

    def error(self, text: str, **_: object) -> None:
        self.errors.append(text)

    warning = info = error


def stamp(rnd: random.Random, header) -> None:
    header.stamp.sec = rnd.choice((-(2**31), -1, 0, 1, 100, 101, 2**31 - 1))
    header.stamp.nanosec = rnd.choice((0, 1, 999_999_999, 2**32 - 1))


def transform(rnd: random.Random) -> TransformStamped:
    message = TransformStamped(child_frame_id=rnd.choice(FRAMES))
    stamp(rnd, message.header)
    message.header.frame_id = rnd.choice(FRAMES)
    to, turn = message.transform.translation, message.transform.rotation
    to.x, to.y, to.z = (rnd.choice(NUMBERS) for _ in range(3))
    if rnd.random() < 0.4:
        turn.x, turn.y, turn.z, turn.w = (rnd.choice(NUMBERS) for _ in range(4))
    return message


def joints(rnd: random.Random) -> JointState:
    def some() -> list[float]:
        return [rnd.choice(NUMBERS) for _ in range(rnd.randrange(5))]

    message = JointState(position=some(), velocity=some(), effort=some())
    message.name = [rnd.choice(JOINTS) for _ in range(rnd.choice((len(message.position), 2)))]
    stamp(rnd, message.header)
    return message


def description(rnd: random.Random, urdf: str) -> String:
    kind = rnd.randrange(4)
    if kind == 0:
        return String(data=rnd.choice(("", "<robot", "\x01", "<robot name='x'/>", "[]", urdf)))
    start, length = rnd.randrange(len(urdf)), rnd.choice((1, 3, 30))
    insert = "" if kind == 1 else rnd.choice(("1e999", '"', "<", "é", "-", "<link name='q'/>"))
    return String(data=urdf[:start] + insert + urdf[start + length :])


@pytest.fixture(scope="module")
def urdf() -> str:
    return load_robot_model(robot_file("kinectbot")).urdf


@pytest.fixture
def ros():
    rclpy.init()
    yield
    rclpy.shutdown()


def test_the_listener_survives_random_messages(ros, urdf):
    rnd, said = random.Random(1), Said()
    buffer, node = Buffer(), rclpy.create_node("listens")
    listener = TransformListener(buffer, node)
    listener._log = said
    listener._on_description(String(data=urdf))
    for round_ in range(3000):
        kind = rnd.randrange(9)
        before = len(said.errors)
        if kind == 0 and round_ % 5 == 0:
            listener._on_description(description(rnd, urdf))
        elif kind < 4:
            message = joints(rnd)
            listener._on_joints(message)
            taken = dict(zip(message.name, message.position, strict=False))
            if not all(map(math.isfinite, taken.values())):
                assert len(said.errors) > before
        else:
            data = type("TFMessage", (), {"transforms": [transform(rnd) for _ in range(3)]})
            (listener.callback if kind < 8 else listener.static_callback)(data)
        try:
            found = buffer.lookup_transform(
                rnd.choice(FRAMES), rnd.choice(FRAMES), transform(rnd).header.stamp
            )
        except TransformException:
            continue
        numbers = found.transform.translation, found.transform.rotation
        assert all(math.isfinite(getattr(numbers[0], axis)) for axis in "xyz")
        assert all(math.isfinite(getattr(numbers[1], axis)) for axis in "xyzw")
    assert "not finite" in " ".join(said.errors)
    listener.unregister()
    node.destroy_node()


def test_the_state_publishers_survive_random_messages(ros, urdf):
    rnd = random.Random(2)
    model = Parameter("robot_description", value=urdf)
    nodes = RobotStatePublisherNode(parameter_overrides=[model]), JointStatePublisherNode()
    sent: list[JointState] = []
    nodes[1]._output = SimpleNamespace(publish=sent.append, wanted=True)
    nodes[1]._on_description(String(data=urdf))
    for _ in range(500):
        message = joints(rnd)
        nodes[0]._on_joints(message)
        nodes[1]._on_measurement(message)
    for _ in range(20):
        nodes[1]._on_description(description(rnd, urdf))
    assert sent
    for message in sent:
        assert len(message.name) == len(message.position)
        assert all(map(math.isfinite, message.position)), "a joint is nowhere"
    for node in nodes:
        node.destroy_node()
