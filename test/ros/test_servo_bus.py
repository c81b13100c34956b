"""The servo bus as ROS tools see it: recovery, stopping and starting, limits, several buses."""

import math

import pytest
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from waiting import wait_for

from head_tracking.control import ControlLoop
from head_tracking.dynamixel import JointConfiguration, ServoState
from head_tracking.ros.bus.servo_bus import ServoBusNode, StatesMessage
from head_tracking.simulation import SimulatedPort, SimulatedServo

PAN, TILT = "head_pan_joint", "head_tilt_joint"


def test_two_buses_in_one_node(threads):
    ports = [SimulatedPort([SimulatedServo(i)]) for i in (1, 2)]
    for port in ports:
        port.open()

    def connect(joints: list[JointConfiguration]) -> str:
        return ports[joints[0].id - 1].port_name

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


def test_joint_names_do_not_depend_on_the_order_of_replies():
    """After a cycle in which one was late, they may come the other way round."""
    pan = ServoState(10, 0.5, 0.0, 0.5)
    tilt = pan._replace(position=-0.3)
    message = StatesMessage({"pan": pan, "tilt": tilt})
    for states in ({"pan": pan, "tilt": tilt}, {"tilt": tilt, "pan": pan}):
        filled = message.filled(states)
        assert dict(zip(filled.name, filled.position, strict=True)) == {"pan": 0.5, "tilt": -0.3}


@pytest.mark.parametrize("name", ["joint_speed", "max_speed"])
def test_speeds_within_the_described_range_are_accepted(threads, name):
    name = f"head_pan_controller.{name}"
    with SimulatedPort([SimulatedServo(1), SimulatedServo(2)]) as simulated:
        node = ServoBusNode(connect=lambda joints: simulated.port_name, namespace="second")
        try:
            (allowed,) = node.describe_parameter(name).floating_point_range
            for speed in (allowed.to_value, 0.999 * allowed.to_value, max(0.1, allowed.from_value)):
                assert node.set_parameters([Parameter(name, value=speed)])[0].successful
            beyond = Parameter(name, value=1.01 * allowed.to_value)
            assert not node.set_parameters([beyond])[0].successful
        finally:
            node.destroy_node()
