"""A driver of other servos: replace `_turn`. Start it beside two nodes.

ros2 run head_tracking robot_state_publisher --ros-args -p robot:=kinectbot
ros2 run head_tracking head_tracker --ros-args -p command_interface:=joint_trajectory
"""

from contextlib import suppress

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory


class Driver(Node):
    """Move the joints to each commanded position, and publish where they are."""

    def __init__(self) -> None:
        super().__init__("own_driver")
        self._positions = {"head_pan_joint": 0.0, "head_tilt_joint": 0.0}  # rad
        self._states = self.create_publisher(JointState, "joint_states", 10)
        topic = "head_controller/joint_trajectory"
        self.create_subscription(JointTrajectory, topic, self._turn, 10)
        self.create_timer(0.02, self._publish)

    def _turn(self, message: JointTrajectory) -> None:
        if message.points:  # none: stay where they are
            self._positions |= zip(message.joint_names, message.points[-1].positions, strict=True)

    def _publish(self) -> None:
        state = JointState(name=list(self._positions), position=list(self._positions.values()))
        state.header.stamp = self.get_clock().now().to_msg()
        self._states.publish(state)


if __name__ == "__main__":
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(Driver())
