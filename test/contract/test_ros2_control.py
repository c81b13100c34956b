"""The servo bus as hardware of ros2_control: the snippet, and what its plugin says and hears."""

import math
import xml.etree.ElementTree as ET

import pytest
import xacro
from rclpy.qos import qos_profile_sensor_data
from rig import JOINTS
from sensor_msgs.msg import JointState
from waiting import wait_for

from head_tracking.share import share_directory


def described(tmp_path, arguments=""):
    """What the snippet adds to a robot's description."""
    file = tmp_path / "robot.urdf.xacro"
    snippet = share_directory() / "urdf" / "head_ros2_control.xacro"
    file.write_text(
        '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        f'<xacro:include filename="{snippet}"/><xacro:head_ros2_control {arguments}/></robot>'
    )
    (found,) = ET.fromstring(xacro.process_file(str(file)).toxml()).iter("ros2_control")
    return found


class JointStateTopicSystem:
    """Stands in for joint_state_topic_hardware_interface/JointStateTopicSystem.

    Its rules: states are taken with the QoS of sensors; commands are sent if they differ from the
    states by more than the threshold, all together; `name` has every joint, and `position` only
    those with that command interface. Before a controller is active, commands are NaN.
    """

    def __init__(self, node, control):
        hardware = control.find("hardware")
        assert hardware.findtext("plugin") == (
            "joint_state_topic_hardware_interface/JointStateTopicSystem"
        )
        said = {param.get("name"): param.text for param in hardware.iter("param")}
        self._threshold = float(said["trigger_joint_command_threshold"])
        joints = {joint.get("name"): joint for joint in control.iter("joint")}
        for joint in joints.values():
            assert joint.find("state_interface[@name='velocity']") is not None
        is_commanded = "command_interface[@name='position']"
        self._commanded = [n for n, joint in joints.items() if joint.find(is_commanded) is not None]
        self.states = {}
        self.commands = dict.fromkeys(joints, math.nan)
        self.sent = 0
        node.create_subscription(
            JointState, said["joint_states_topic"], self._on_states, qos_profile_sensor_data
        )
        self._publisher = node.create_publisher(JointState, said["joint_commands_topic"], 1)
        self._clock = node.get_clock()
        self._timer = node.create_timer(0.01, self._write)

    def _on_states(self, message):
        assert len(message.velocity) == len(message.name)
        self.states |= dict(zip(message.name, message.position, strict=True))

    def activate(self):
        """A controller takes the joints where they are."""
        self.commands = {name: self.states[name] for name in self.commands}

    def _write(self):
        off = sum(abs(self.states.get(name, 0.0) - told) for name, told in self.commands.items())
        if off <= self._threshold:
            return
        message = JointState(name=list(self.commands))
        message.header.stamp = self._clock.now().to_msg()
        message.position = [self.commands[name] for name in self._commanded]
        self.sent += 1
        self._publisher.publish(message)


def test_the_snippet_takes_other_names(tmp_path):
    control = described(
        tmp_path, 'name="left" namespace="/left/" pan_joint="yaw" tilt_joint="nod" threshold="0.01"'
    )
    assert control.get("name") == "left"
    assert [joint.get("name") for joint in control.iter("joint")] == ["yaw", "nod"]
    said = {param.get("name"): param.text for param in control.iter("param")}
    assert said["joint_commands_topic"] == "/left/joint_commands"
    assert said["joint_states_topic"] == "/left/servo_states"
    assert float(said["trigger_joint_command_threshold"]) == 0.01


def test_the_messages_match_those_of_the_plugin(bench, tmp_path):
    person, servos = bench.person, bench.servos
    left_out = ("head", "robot_state_publisher", "joint_state_publisher")
    words = [word for name in left_out for word in ("--without", name)]
    bench.run(*words, ros=("-p", "servo_bus:reply_timeout:=0.1"))  # STOP waits twice as long
    system = JointStateTopicSystem(person.node, described(tmp_path))
    wait_for(lambda: set(JOINTS) <= system.states.keys())
    person.wait_for_node("servo_bus")
    assert not {"head_tracker", *left_out} & set(person.node.get_node_names())
    assert tuple(system.commands) == JOINTS
    wait_for(lambda: system.sent > 20)
    person.complaint("servo_bus", "nan")  # no controller is active
    assert servos.torque == [0, 0]
    assert servos.true == (0.0, 0.0)
    system.activate()
    system.commands.update(head_pan_joint=0.4, head_tilt_joint=-0.2)
    wait_for(lambda: servos.true == pytest.approx((0.4, -0.2), abs=0.012))
    wait_for(lambda: set(person.owners.values()) == {"somebody"})
    person.until_done("stop")
    system.commands.update(head_pan_joint=-0.4)
    stopped = servos.at_rest()
    sent = system.sent
    wait_for(lambda: system.sent > sent + 30)
    assert servos.at_rest() == pytest.approx(stopped, abs=0.012)
    person.until_done("resume")
    wait_for(lambda: abs(system.states["head_pan_joint"] + 0.4) < 0.012)
