"""Targets are heard whatever their publishers promise; who is not heard is named."""

import subprocess
import sys
from contextlib import ExitStack, closing
from itertools import product

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Point, PointStamped, PoseStamped
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String
from waiting import wait_for

from head_tracking.ros.kit.spinning import NodeThreads
from head_tracking.ros.kit.topics import LATCHED, TopicListener

NO_SIGNALS = SignalHandlerOptions.NO
PROMISES = list(
    product(
        (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT),
        (DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL),
    )
)


@pytest.fixture(scope="module")
def robot(make_module_robot):
    robot = make_module_robot("--target", "mux")
    mux = robot.composition.nodes["target_mux"]
    robot.fixed_frame = mux.get_parameter("fixed_frame").value  # in which it passes them on
    mux.set_parameters([Parameter("switch_time", value=0.0)])
    return robot


@pytest.mark.parametrize("topic", ["target_point", "clicked_point"])
@pytest.mark.parametrize(("reliability", "durability"), PROMISES)
def test_targets_are_received_from_publishers_of_any_qos(robot, reliability, durability, topic):
    qos = QoSProfile(depth=5, reliability=reliability, durability=durability)
    publisher = robot.node.create_publisher(PointStamped, topic, qos)
    number = PROMISES.index((reliability, durability))
    away = 2.0 + 0.1 * number + (0.05 if topic != "target_point" else 0.0)
    message = PointStamped(point=Point(x=away, y=0.0, z=0.0))
    message.header.frame_id = robot.fixed_frame
    tracker = robot.composition.nodes["head_tracker"]

    def heard() -> bool:
        publisher.publish(message)
        target = tracker.control.frames.target
        return target is not None and target.point[0] == pytest.approx(away)

    try:
        wait_for(heard)
        assert not tracker.unheard
    finally:
        robot.node.destroy_publisher(publisher)


# Publishes one message on each topic, as soon as somebody listens, and stays for their delivery.
PERSON = """
import sys, time, rclpy
from std_msgs.msg import String
rclpy.init()
node = rclpy.create_node("person")
for topic in sys.argv[1:]:
    publisher = node.create_publisher(String, topic, 10)
    while not publisher.get_subscription_count():
        time.sleep(0.001)
    publisher.publish(String(data=topic))
sys.stdin.read()
"""


@pytest.fixture
def hear(domain, monkeypatch):
    """What is heard by a node of the topics on which a new process publishes once."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=int(domain), signal_handler_options=NO_SIGNALS)
    node = Node("head", context=context)
    with ExitStack() as stack:
        stack.callback(context.try_shutdown)
        stack.enter_context(closing(NodeThreads())).start(node)

        def hear(*topics: str) -> list[str]:
            heard: list[str] = []
            for topic in topics:
                TopicListener(node, String, topic, lambda message: heard.append(message.data))
            person = subprocess.Popen(
                [sys.executable, "-c", PERSON, *topics], stdin=subprocess.PIPE
            )
            stack.enter_context(person)  # closes its input, and waits
            stack.callback(person.kill)
            return heard

        yield hear


def test_the_only_message_of_a_new_publisher_is_received(hear):
    topics = [f"topic_{number}" for number in range(60)]
    heard = hear(*topics)
    wait_for(lambda: sorted(heard) == sorted(topics))


def test_publishers_of_another_type_are_reported(start, domain, monkeypatch):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=int(domain), signal_handler_options=NO_SIGNALS)
    states: list[str] = []
    levels: dict[bytes, str] = {}
    try:
        with closing(NodeThreads()) as threads:
            person = Node("person", context=context)
            person.create_publisher(PoseStamped, "target_point", 10)
            person.create_subscription(
                String, "head_tracker/state", lambda message: states.append(message.data), LATCHED
            )

            def on_diagnostics(message: DiagnosticArray) -> None:
                levels.update((s.level, v.value) for s in message.status for v in s.values)

            person.create_subscription(DiagnosticArray, "/diagnostics", on_diagnostics, 10)
            threads.start(person)
            start("head_tracker")
            wait_for(lambda: states and "/person" in states[-1] and "Pose" in states[-1], 30.0)
            wait_for(lambda: "/person" in levels.get(DiagnosticStatus.WARN, ""), 30.0)
    finally:
        rclpy.try_shutdown(context=context)
