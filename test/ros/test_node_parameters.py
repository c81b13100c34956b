"""Parameters: declared with meaning, unit and range; a bad value is refused with a reason."""

from dataclasses import dataclass

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import ReliabilityPolicy
from std_msgs.msg import Float64

from head_tracking.parameters import parameter
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.topics import OVERRIDABLE, TopicListener
from head_tracking.ros.targets.target_mux import TargetMuxNode


@dataclass(frozen=True)
class Example:
    speed: float = parameter(1.0, "Speed.", unit="rad/s", minimum=0.1, maximum=2.0)
    axis: tuple[float, ...] = parameter((1.0, 0.0, 0.0), "Axis.")


pytestmark = pytest.mark.usefixtures("threads")
ONCE = {"depth": 1, "reliability": "best_effort"}


def make(**overrides):
    given = [Parameter(name, value=value) for name, value in overrides.items()]
    return Node("example", parameter_overrides=given)


def test_defaults_and_given_values():
    assert NodeParameters(make(), Example).value == Example()
    given = NodeParameters(make(speed=2, axis=[0, 1, 0]), Example).value
    assert given == Example(speed=2.0, axis=(0.0, 1.0, 0.0))


def test_an_empty_list_is_a_value():
    """Such as in a file of `ros2 param dump`."""
    node = Node("example", cli_args=["--ros-args", "-p", "axis:=[]"])
    assert NodeParameters(node, Example).value.axis == ()
    assert node.get_parameter("axis").value == []


@pytest.mark.parametrize("distribution", ["humble", "jazzy"])
def test_a_value_can_be_changed_while_running(monkeypatch, distribution):
    if distribution == "humble":
        monkeypatch.delattr(Node, "add_post_set_parameters_callback")
    node, seen = make(), []
    parameters = NodeParameters(node, Example, on_change=seen.append)
    assert node.set_parameters([Parameter("speed", value=0.5)])[0].successful
    assert parameters.value.speed == 0.5
    assert seen == [Example(speed=0.5)]


def test_parameters_change_the_delivery_of_topics():
    publisher = {f"qos_overrides./angle.publisher.{k}": v for k, v in ONCE.items()}
    subscription = {f"qos_overrides./angle.subscription.{k}": v for k, v in ONCE.items()}
    node = make(**publisher, **subscription)
    node.create_publisher(Float64, "angle", 10, qos_overriding_options=OVERRIDABLE)
    TopicListener(node, Float64, "angle", lambda _: None)
    (offered,) = node.get_publishers_info_by_topic("/angle")
    (wanted,) = node.get_subscriptions_info_by_topic("/angle")
    for endpoint in (offered, wanted):
        assert endpoint.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
    assert node.get_parameter("qos_overrides./angle.publisher.depth").value == 1


def test_an_empty_topic_of_a_source_is_the_usual_one():
    node = TargetMuxNode(parameter_overrides=[Parameter("clicked_point.topic", value="")])
    topics = dict(node.get_subscriber_names_and_types_by_node("target_mux", "/"))
    assert {"/clicked_point/target_point", "/visual_target/target_point"} <= topics.keys()
