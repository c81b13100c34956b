"""The tracker as a node: laws, states, life cycle, reports."""

import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from robot_under_test import wait_for
from std_msgs.msg import Float64, String

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture
def robot(tracking_robot):
    """A robot whose tracker's states are listened to."""
    tracking_robot.states = []
    tracking_robot.node.create_subscription(
        String, "head_tracker/state", lambda m: tracking_robot.states.append(m.data), LATCHED
    )
    return tracking_robot


@pytest.fixture
def tracker(robot):
    return robot.composition.nodes["head_tracker"]


def look(robot, point, until, frame="torso_link"):
    deadline = time.monotonic() + 15
    while not until():
        assert time.monotonic() < deadline, (robot.pan, robot.tilt, robot.states[-3:])
        robot.look_at(*point, frame, robot.node.get_clock().now().to_msg())
        time.sleep(0.03)


def in_state(robot, state):
    return lambda: robot.states and robot.states[-1].startswith(f"{state}:")


def test_the_predictive_law_is_the_default(tracker):
    assert tracker.get_parameter("law").value == "predictive"


def test_laws_are_switched_while_the_head_moves(robot, tracker):
    look(robot, (1, 1, 0), lambda: robot.pan > 0.2)
    for law, side in (("speed", -1), ("position", 1), ("predictive", -1)):
        assert tracker.set_parameters([Parameter("law", value=law)])[0].successful
        look(robot, (1, side, 0), lambda side=side: robot.pan * side > 0.3)


def test_an_unknown_law_is_refused_and_the_old_one_stays(robot, tracker):
    refused = tracker.set_parameters([Parameter("law", value="magic")])[0]
    assert not refused.successful
    assert "predictive, speed, position" in refused.reason
    assert tracker.get_parameter("law").value == "predictive"
    look(robot, (1, 1, 0), lambda: robot.pan > 0.3)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("max_joint_acceleration", 0.0),
        ("target_timeout", -1.0),
        ("dead_band", 5.0),
        ("jump_threshold", "far"),
    ],
)
def test_bad_values_are_refused_with_a_reason(tracker, name, value):
    before = tracker.get_parameter(name).value
    refused = tracker.set_parameters([Parameter(name, value=value)])[0]
    assert not refused.successful
    assert name in refused.reason
    assert tracker.get_parameter(name).value == before


def test_states_and_their_reasons(robot, tracker):
    wait_for(in_state(robot, "idle"))
    assert "no target has come yet" in robot.states[-1]
    look(robot, (1, 0.5, 0), in_state(robot, "tracking"))
    wait_for(in_state(robot, "holding"))
    assert any(state.startswith("coasting:") for state in robot.states)
    look(robot, (-2, 0.3, 0), in_state(robot, "at the limit"))
    assert "out of reach" in robot.states[-1]
    assert robot.call("head_tracker/enable", False).success
    wait_for(in_state(robot, "disabled"))
    assert robot.call("head_tracker/enable", True).success
    wait_for(in_state(robot, "idle"))


def test_switched_off_it_stops_at_once(robot):
    look(robot, (1, 1.5, 0), lambda: robot.pan > 0.2)
    assert robot.call("head_tracker/enable", False).success
    pan = robot.pan
    rest, _ = robot.at_rest()
    assert abs(rest - pan) < 0.25  # it was at several rad/s when the service was called
    assert robot.composition.loop.owners.of(["head_pan_joint"]) == {"head_pan_joint": ""}
    time.sleep(0.3)
    assert robot.pan == pytest.approx(rest, abs=0.006)  # a tick
    assert not robot.call("head_tracker/recenter").success


def test_after_the_timeout_it_recentres(robot, tracker):
    assert tracker.set_parameters([Parameter("recenter_timeout", value=1.0)])[0].successful
    look(robot, (1, 0.3, 0), in_state(robot, "tracking"))
    wait_for(in_state(robot, "recentering"))
    wait_for(in_state(robot, "idle"), 15)
    assert abs(robot.pan) < 0.05


def test_the_search_is_interrupted_by_any_target(robot, tracker):
    assert all(
        result.successful
        for result in tracker.set_parameters(
            [
                Parameter("enable_target_search", value=True),
                Parameter("search_target_timeout", value=0.8),
                Parameter("default_joint_speed", value=1.5),
            ]
        )
    )
    look(robot, (1, 0.3, 0), in_state(robot, "tracking"))
    wait_for(in_state(robot, "searching"))
    wait_for(lambda: abs(robot.pan) > 1.2, 10)
    look(robot, (1, 0.3, 0), in_state(robot, "tracking"))


def test_a_frame_that_nobody_knows_moves_nothing(robot):
    look(robot, (1, 0.5, 0), in_state(robot, "tracking"))
    pan = robot.pan
    for _ in range(40):
        robot.look_at(1, -1, 0, "nowhere", robot.node.get_clock().now().to_msg())
        time.sleep(0.03)
    assert robot.pan == pytest.approx(pan, abs=0.05)
    robot.logged("nowhere")


def test_delays_are_reported(robot):
    messages = robot.listen("/diagnostics", DiagnosticArray)
    look(robot, (1, 0.5, 0), in_state(robot, "tracking"))

    def tracker_values():
        return [
            {pair.key: pair.value for pair in status.values}
            for message in messages
            for status in message.status
            if status.name.startswith("head_tracker")
        ]

    look(robot, (1, 0.5, 0), lambda: len(tracker_values()) > 2)
    values = tracker_values()[-1]
    assert values["law"] == "predictive"
    for name in ("age of a target (ms)", "pan servo's delay (ms)", "targets per second"):
        assert float(values[name]) >= 0.0


def test_the_error_is_published_while_there_is_a_target(robot):
    errors = robot.listen("head_tracker/tracking_error", Float64)
    look(robot, (1, 0.5, 0), in_state(robot, "tracking"))
    assert errors
    assert errors[-1].data < 0.05


@pytest.mark.parametrize(
    ("service", "data"), [("relax", None), ("head_pan_controller/torque_enable", False)]
)
def test_servos_that_were_relaxed_are_told_of_in_the_state(robot, service, data):
    look(robot, (1, 0.7, 0), in_state(robot, "tracking"))
    assert robot.call(service, data).success
    robot.states.clear()
    look(robot, (1, -0.7, 0), in_state(robot, "stalled"))
    assert "head_pan_joint" in robot.states[-1]
    robot.states.clear()
    for _ in range(30):
        robot.look_at(1, -0.7, 0, "torso_link", robot.node.get_clock().now().to_msg())
        time.sleep(0.03)
    assert not any(state.startswith("tracking:") for state in robot.states)
    assert robot.call("torque_enable", True).success
    look(robot, (1, -0.7, 0), in_state(robot, "tracking"))


@pytest.mark.parametrize("mode", ["track", "point"])
def test_a_foreign_robot_description_does_not_end_the_run(make_robot, mode):
    robot = make_robot("--mode", mode, "--target", "none")
    foreign = '<robot name="arm"><link name="shoulder"/></robot>'
    publisher = robot.node.create_publisher(String, "robot_description", LATCHED)
    wait_for(lambda: publisher.get_subscription_count() > 0)
    publisher.publish(String(data=foreign))
    robot.logged("another robot_description is not used")
    for side in (1, -1):
        deadline = time.monotonic() + 15
        while robot.pan * side < 0.4:
            assert time.monotonic() < deadline
            robot.look_at(1, side, 0, "base_link")
            time.sleep(0.05)
    assert robot.threads.failure is None
