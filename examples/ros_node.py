"""A ROS 2 node that follows `target_point`: ros_node.py /dev/ttyUSB0, or --sim."""

import sys
from contextlib import suppress

import rclpy
from geometry_msgs.msg import PointStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.time import Time
from std_msgs.msg import Float64

from head_tracking import Head, HeadTrackingError


class HeadNode(Node):
    """Follow `target_point` and publish `tracking_error`."""

    def __init__(self, head: Head) -> None:
        super().__init__("own_head")
        self._head = head
        self._errors = self.create_publisher(Float64, "tracking_error", 10)
        self.create_subscription(PointStamped, "target_point", self._follow, 10)

    def _follow(self, message: PointStamped) -> None:
        point, stamp = message.point, Time.from_msg(message.header.stamp).nanoseconds * 1e-9
        try:
            self._head.follow((point.x, point.y, point.z), message.header.frame_id, stamp=stamp)
        except (HeadTrackingError, ValueError) as error:
            self.get_logger().error(str(error))
        if self._head.error is not None:
            self._errors.publish(Float64(data=self._head.error))


if __name__ == "__main__":
    rclpy.init()
    port = (sys.argv[1:] or ["--sim"])[0]
    opened = Head.simulated() if port == "--sim" else Head.open(port)
    with opened, suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(HeadNode(opened))
