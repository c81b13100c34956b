"""Whatever comes in on a topic of transforms or joints: nothing dies, and the reason is said."""

import math
import random
from types import SimpleNamespace

from geometry_msgs.msg import TransformStamped
from lockstep import World
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from head_tracking.ros.robot.joint_state_publisher import JointStatePublisherNode
from head_tracking.ros.robot.robot_state_publisher import RobotStatePublisherNode
from head_tracking.tf import TransformException

NUMBERS = (0.0, 1.0, -0.5, 1e-320, 1e12, 1e308, -1.7e308, math.nan, math.inf, -math.inf)
FRAMES = ("", "/", "a", "/a", "b", "base_link", "camera_link", "//", "ä b", "x" * 300)
OUTPUT = "joint_states:=completed"
JOINTS = ("", "head_pan_joint", "head_tilt_joint", "head_pan_joint", "left_wheel_joint", "?")


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


def test_the_state_publishers_survive_random_messages(kinectbot, threads):
    rnd, world, urdf = random.Random(1), World(kinectbot), kinectbot.urdf
    parameters = {"robot_description": urdf}
    nodes = [
        world.make(RobotStatePublisherNode, parameters, buffer=world.buffer),
        world.make(JointStatePublisherNode, {}, cli_args=["--ros-args", "-r", OUTPUT]),
    ]
    world.publish("/robot_description", String(data=urdf))
    sent = world.record("/completed")
    for _ in range(1500):
        kind = rnd.randrange(40)
        if kind == 0:
            world.publish("/robot_description", description(rnd, urdf))
        elif kind < 15:
            world.publish("/servo_states", joints(rnd))
        elif kind < 25:
            world.publish("/joint_states", joints(rnd))
        else:
            topic = "/tf" if kind < 35 else "/tf_static"
            data = SimpleNamespace(transforms=[transform(rnd) for _ in range(3)])
            world.publish(topic, data)
        world.run(0.002)
        try:
            found = world.buffer.lookup_transform(
                rnd.choice(FRAMES), rnd.choice(FRAMES), transform(rnd).header.stamp
            )
        except TransformException:
            continue
        numbers = found.transform.translation, found.transform.rotation
        assert all(math.isfinite(getattr(numbers[0], axis)) for axis in "xyz")
        assert all(math.isfinite(getattr(numbers[1], axis)) for axis in "xyzw")
    assert sent
    for _, message in sent:
        assert len(message.name) == len(message.position)
        assert all(map(math.isfinite, message.position)), "a joint is nowhere"
    for node in nodes:
        node.destroy_node()
