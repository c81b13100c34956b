"""Nodes that can be switched on and off: a service to ask, a latched topic that tells."""

from __future__ import annotations

from rclpy.node import Node
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from head_tracking.ros.kit.qos import LATCHED


class Switch:
    """Offers `~/enable`, and publishes `~/enabled`, so that nobody else has to remember it.

    Args:
        node: is switched.
        subject, done: the answer says that this is done, or not done any more.

    Attributes:
        on: whether the node is switched on; it is at the start.
    """

    def __init__(self, node: Node, subject: str = "the target is", done: str = "sent") -> None:
        self.on = True
        self._subject, self._done = subject, done
        self._publisher = node.create_publisher(Bool, "~/enabled", LATCHED)
        node.create_service(SetBool, "~/enable", self._on_enable)
        self._publisher.publish(Bool(data=True))

    def set(self, on: bool) -> None:
        """Enable or disable the node."""
        self.on = on
        self._publisher.publish(Bool(data=on))

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.set(request.data)
        done = self._done if self.on else f"not {self._done} any more"
        response.success, response.message = True, f"{self._subject} {done}"
        return response
