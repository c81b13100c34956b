"""What parameter files say to nobody is said to the person who wrote them."""

import re

import pytest
import rclpy
from rclpy.node import Node

from head_tracking.parameter_files import ParameterFileError, read
from head_tracking.parameters import ParameterError
from head_tracking.ros.head.head_tracker import HeadTrackerNode
from head_tracking.ros.kit.node_parameters import (
    Given,
    UnknownParametersError,
    check_parameters,
    source,
)
from head_tracking.ros.kit.spinning import start_ros
from head_tracking.run.node_sets import simulated_camera


@pytest.fixture
def started(tmp_path):
    """Makes nodes that were given a file."""

    def start(text, *arguments):
        file = tmp_path / "mine.yaml"
        file.write_text(text)
        start_ros(["program", "--ros-args", "--params-file", str(file), *arguments])
        return HeadTrackerNode

    yield start
    rclpy.try_shutdown()


@pytest.mark.parametrize(
    ("nodes", "node", "taken"),
    [
        ("servo_bus", "/servo_bus", True),
        ("servo_bus", "/left/servo_bus", False),
        ("/**/servo_bus", "/servo_bus", True),
        ("/**/servo_bus", "/robots/left/servo_bus", True),
        ("/*/servo_bus", "/servo_bus", False),
        ("/left/**", "/left/servo_bus", True),
    ],
)
def test_a_value_is_for_the_nodes_that_ros_gives_it_to(started, nodes, node, taken, tmp_path):
    assert Given("", nodes, "rate").is_for(node) is taken
    started(f"{nodes}:\n  ros__parameters: {{mine: 1}}\n")
    namespace, name = node.rsplit("/", 1)
    made = Node(name, namespace=namespace, automatically_declare_parameters_from_overrides=True)
    assert made.has_parameter("mine") is taken
    if taken:
        assert source(made, "mine") == str(tmp_path / "mine.yaml")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("/**/head_tracker: {ros__parameters: {xyz: {w: 3.0}}}", ["no parameter xyz.w"]),
        ("head_traker: {ros__parameters: {rate: 3.0}}", ["no node head_traker (is head_tracker"]),
        (
            "head_tracker: {ros__parameters: {rat: 3.0, camera_lnk: eye}}",
            ["parameter rat in /head_tracker (is rate m", "lnk in /head_tracker (is camera_"],
        ),
    ],
)  # fmt: skip
def test_what_no_node_knows_is_named_with_its_file_and_the_nearest_that_exists(
    started, tmp_path, text, words
):
    node = started(text)()
    with pytest.raises(UnknownParametersError) as error:
        check_parameters([node])
    for word in [str(tmp_path / "mine.yaml"), *words]:
        assert word in str(error.value)


def test_a_parameter_without_a_node_is_refused_with_the_node_that_has_it(started):
    tracker, other = started("", "-p", "law:=position")(), Node("other")
    with pytest.raises(UnknownParametersError, match="-p head_tracker:law:=position"):
        check_parameters([tracker, other])
    check_parameters([other], names=False)  # a camera's process does not know the tracker


def test_a_parameter_that_no_node_has_is_reported_once(started):
    nodes = [started("", "-p", "max_joint_sped:=1.0")(), Node("other"), Node("third")]
    with pytest.raises(UnknownParametersError) as error:
        check_parameters(nodes)
    assert str(error.value) == (
        "the command line: no parameter max_joint_sped in /head_tracker, /other, /third "
        "(is max_joint_speed or max_joint_jerk meant?); nothing was moved"
    )


def test_a_file_of_another_kind_is_named_without_its_contents(tmp_path):
    file = tmp_path / "robot.urdf"
    file.write_text(f"<robot>{'<link/>' * 1000}</robot>")
    with pytest.raises(ParameterFileError) as error:
        read(str(file))
    assert len(str(error.value)) < 400


@pytest.mark.parametrize(
    "text",
    [
        "/**: {ros__parameters: {use_sim_time: false, robot_name: rosie}}",
        "lidar_driver: {ros__parameters: {scan_rate: 10.0}}",
        "servo_bus_left: {ros__parameters: {rat: 8081}}",
        "/**/point_head: {ros__parameters: {min_tilt: -1.0}}",  # as in config/kinectbot.yaml
        "/left/head_tracker: {ros__parameters: {rat: 30.0}}",
        "head_tracker: {ros__parameters: {qos_overrides: {/tf: {publisher: {depth: 1}}}}}",
        "",
    ],
)
def test_what_is_known_or_others_own_is_no_mistake(started, text):
    node = started(text)()
    check_parameters([node])


def test_each_wrong_value_is_named_with_node_and_file(started, tmp_path):
    make = started("head_tracker: {ros__parameters: {servo_learning: 3, camera_learning: 7}}")
    with pytest.raises(ParameterError) as error:
        make()
    where = f"{tmp_path / 'mine.yaml'}: /head_tracker: "
    assert f"{where}servo_learning is 3; it must be text" in str(error.value)
    assert f"{where}camera_learning is 7" in str(error.value)


@pytest.mark.parametrize(
    ("first", "later", "arguments", "rate", "law"),
    [
        ("{rate: 30}", "{rate: 1e1}", [], 10.0, "predictive"),
        ("{rate: 30}", "{law: speed}", ["-p", "head_tracker:rate:=12.5"], 12.5, "speed"),
        ("{rate: 30}", "{}", ["-p", "rate:=12.5"], 12.5, "predictive"),
    ],
)
def test_the_latest_value_wins_also_with_another_type(
    started, tmp_path, first, later, arguments, rate, law
):
    file = tmp_path / "later.yaml"
    file.write_text(f"/**: {{ros__parameters: {later}}}")
    make = started(f"/**: {{ros__parameters: {first}}}", "--params-file", str(file), *arguments)
    node = make()
    check_parameters([node])
    assert node.get_parameter("rate").value == rate
    assert node.get_parameter("law").value == law


@pytest.mark.parametrize(
    "content",
    [
        b"servo_bus:\n  ros__parameters:\n   a: [1\n  b: 2\n",
        b"- 1\n- 2\n",
        b"servo_bus:\n  ros__parameters: 2\n",
        b"/**: {ros__parameters: {rate: 30}}\n/**: {ros__parameters: {law: speed}}\n",
        b"servo_bus: {ros__parameters: {rate: 30, rate: 10}}\n",
        b"servo_bus: {ros__parameters: {since: 2024-13-45}}\n",
        "servo_bus:\n".encode("utf-16"),
        None,  # a folder
    ],
)
def test_a_malformed_file_is_refused_in_one_line(started, tmp_path, content):
    file = tmp_path / "other.yaml"
    file.mkdir() if content is None else file.write_bytes(content)
    with pytest.raises(ParameterFileError) as error:
        started("", "--params-file", str(file))
    assert str(file) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["rate", "qos_overrides./left/target_point.subscription.depth"])
def test_a_rule_for_a_node_sets_any_parameter_in_a_namespace(started, name):
    node = started("", "-r", "__ns:=/left", "-p", f"head_tracker:{name}:=7")()
    check_parameters([node])
    assert node.get_parameter(name).value == 7


def test_a_value_that_is_given_replaces_the_usual_one_of_a_run(started):
    started("", "-p", "simulated_camera:width:=64")
    camera = simulated_camera("ball", shown=False).make({"buffer": None})
    shown = [camera.get_parameter(name).value for name in ("scene", "width", "height")]
    camera.destroy_node()
    assert shown == ["ball", 64, 240]


@pytest.mark.parametrize("rule", ["servo_bus:rate:=", "rate:=[1, x]"])
def test_a_rule_without_a_value_is_refused(started, rule):
    with pytest.raises(ParameterFileError, match=re.escape(rule)):
        started("", "-p", rule)
