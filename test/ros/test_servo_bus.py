"""The servo bus as ROS tools see it: recovery, stopping and starting, limits, several buses."""

import math

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, SetParameters
from robot_under_test import wait_for
from sensor_msgs.msg import JointState

from head_tracking.control import ControlLoop
from head_tracking.dynamixel import ErrorBits, JointConfiguration, ServoState
from head_tracking.nodes.servo_bus import ServoBusNode, StatesMessage
from head_tracking.simulation import SimulatedPort, SimulatedServo

PAN, TILT = "head_pan_joint", "head_tilt_joint"


def register(robot, servo_id, name):
    return robot.simulated.port.use(lambda bus: bus[servo_id].register(name))


def set_parameter(robot, name, value):
    client = robot.node.create_client(SetParameters, "servo_bus/set_parameters")
    wait_for(client.service_is_ready)
    kind = ParameterType.PARAMETER_INTEGER
    content = ParameterValue(type=kind, integer_value=value)
    if isinstance(value, float):
        content = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
    request = SetParameters.Request(parameters=[ParameterMessage(name=name, value=content)])
    future = client.call_async(request)
    wait_for(future.done)
    return future.result().results[0]


def level(messages, name):
    """Of the newest entry, an integer."""
    entries = [s for s in messages[-1].status if s.name.endswith(name)] if messages else []
    return entries[0].level if entries else None


@pytest.fixture
def robot(pointing_robot):
    return pointing_robot


def test_an_overloaded_servo_is_reported_and_recovered_by_the_service(robot):
    diagnostics = robot.listen("/diagnostics", DiagnosticArray)
    robot.command("head_pan_controller/command", 0.3)
    wait_for(lambda: robot.pan > 0.28)
    robot.simulated.port.use(lambda bus: bus[1].overload())
    robot.logged("has shut itself down: overload")
    wait_for(lambda: level(diagnostics, PAN) == DiagnosticStatus.ERROR)
    assert register(robot, 1, "Torque Enable") == 0
    answer = robot.call("recover")
    assert answer.success, answer.message
    assert PAN in answer.message
    assert register(robot, 1, "Torque Limit") == 1023
    robot.command("head_pan_controller/command", -0.2)
    wait_for(lambda: robot.pan < -0.18)
    assert "no servo has a fault" in robot.call("head_pan_controller/recover").message


def test_a_controller_is_stopped_and_started_without_the_other(robot):
    robot.command("head_pan_controller/command", 0.2)
    wait_for(lambda: robot.pan > 0.18)
    assert robot.call("head_pan_controller/stop").success
    heard = robot.heard_of(PAN)
    robot.command("head_tilt_controller/command", 0.2)
    wait_for(lambda: robot.tilt > 0.18)
    assert robot.heard_of(PAN) <= heard + 0.1
    robot.forget_log()
    robot.command("head_pan_controller/command", 0.0)
    robot.logged("start it first (head_pan_controller/start)")
    assert robot.call("head_pan_controller/restart").success
    robot.command("head_pan_controller/command", 0.0)
    wait_for(lambda: abs(robot.pan) < 0.02)


def test_limits_change_while_the_head_runs_and_nonsense_is_refused(robot):
    assert set_parameter(robot, "head_pan_controller.motor.max", 600).successful
    robot.forget_log()
    robot.command("head_pan_controller/command", 0.9)
    robot.logged("goal position 0.9000 rad refused; allowed are")
    refused = set_parameter(robot, "head_pan_controller.motor.max", 2000)
    assert not refused.successful and "range" in refused.reason
    assert set_parameter(robot, "head_pan_controller.motor.max", 1023).successful
    assert set_parameter(robot, "head_pan_controller.max_speed", 2.5).successful
    refused = set_parameter(robot, "head_pan_controller.max_speed", 50.0)
    assert not refused.successful and "max_speed" in refused.reason
    robot.command("head_pan_controller/command", 0.9)
    wait_for(lambda: robot.pan > 0.88)


@pytest.mark.parametrize("name", ["joint_speed", "max_speed"])
def test_every_speed_that_is_described_as_allowed_is_taken(robot, name):
    name = f"head_pan_controller.{name}"
    client = robot.node.create_client(DescribeParameters, "servo_bus/describe_parameters")
    wait_for(client.service_is_ready)
    future = client.call_async(DescribeParameters.Request(names=[name]))
    wait_for(future.done)
    (allowed,) = future.result().descriptors[0].floating_point_range
    for speed in (allowed.to_value, 0.999 * allowed.to_value, max(0.1, allowed.from_value)):
        assert set_parameter(robot, name, speed).successful
    assert not set_parameter(robot, name, 1.01 * allowed.to_value).successful


def test_the_servos_memory_is_written_on_request_only_and_only_while_relaxed(robot):
    assert register(robot, 2, "CCW Angle Limit") == 1023
    robot.call("torque_enable", True)
    refused = robot.call("servo_bus/write_eeprom")
    assert not refused.success and "relax it" in refused.message
    robot.call("relax")
    answer = robot.call("servo_bus/write_eeprom")
    assert answer.success, answer.message
    assert "servo 2: CCW Angle Limit 1023 -> 800" in answer.message
    assert register(robot, 2, "CCW Angle Limit") == 800
    assert register(robot, 1, "Return Delay Time") == 0
    assert robot.call("servo_bus/write_eeprom").message == "nothing to change"


def test_an_adapter_that_is_pulled_out_and_put_back_is_found(make_robot, tmp_path):
    robot = make_robot("--mode", "point")
    del robot  # ROS is up
    link = tmp_path / "servos"
    with SimulatedPort([SimulatedServo(1), SimulatedServo(2)], link=link) as simulated:
        node = ServoBusNode(connect=lambda joints: str(link), namespace="second")
        try:
            wait_for(lambda: len(node.status().states) == 2)
            simulated.unplug()
            wait_for(lambda: not node.status().statistics.connected)
            wait_for(lambda: not node.status().states)
            simulated.replug()
            wait_for(lambda: len(node.status().states) == 2)
            assert node.status().statistics.port_losses == 1
        finally:
            node.destroy_node()


def test_two_buses_in_one_node(make_robot):
    make_robot("--mode", "point")
    ports = [SimulatedPort([SimulatedServo(i)]) for i in (1, 2)]
    for port in ports:
        port.open()

    def connect(joints: list[JointConfiguration]) -> str:
        return ports[joints[0].id - 1].port_name

    from rclpy.parameter import Parameter

    overrides = [Parameter("head_tilt_controller.port_name", value="/dev/ttyUSB1")]
    loop = ControlLoop(None)
    node = ServoBusNode(connect, loop, namespace="both", parameter_overrides=overrides)
    try:
        wait_for(lambda: set(node.status().states) == {PAN, TILT})
        assert node.status().port_name.count("/dev/pts/") == 2
        node._on_joint_commands(JointState(name=[PAN, TILT], position=[math.nan, math.inf]))
        assert loop.owners.of([PAN, TILT]) == {PAN: "", TILT: ""}  # what is refused claims nothing
        node._on_joint_commands(JointState(name=[PAN, TILT], position=[0.2, -0.2]))
        wait_for(lambda: ports[0].true_ticks(1) > 512 + 35)
        wait_for(lambda: ports[1].true_ticks(2) < 512 - 35)
    finally:
        node.destroy_node()
        for port in ports:
            port.close()


def test_joints_that_answer_in_another_order_keep_their_names():
    """After a cycle in which one was late, they may come the other way round."""
    pan = ServoState("pan", 1, 10, 0.5, 0.0, 0.1, 11.9, 35.0, ErrorBits(0), True, 0.5)
    tilt = pan._replace(joint_name="tilt", id=2, position=-0.3)
    message = StatesMessage({"pan": pan, "tilt": tilt})
    for states in ({"pan": pan, "tilt": tilt}, {"tilt": tilt, "pan": pan}):
        filled = message.filled(states)
        assert dict(zip(filled.name, filled.position, strict=True)) == {"pan": 0.5, "tilt": -0.3}
