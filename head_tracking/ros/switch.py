"""Nodes that can be switched on and off: a service to ask, a latched topic that tells."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from head_tracking.tf.qos import LATCHED


class Switch:
    """Offers `~/enable`, and publishes `~/enabled`, so that nobody else has to remember it.

    Args:
        node: is switched.
        on_change: called with the new state, in the node's thread; what it returns is the answer.

    Attributes:
        on: whether the node is switched on; it is at the start.
    """

    def __init__(self, node: Node, on_change: Callable[[bool], str]) -> None:
        self.on = True
        self._on_change = on_change
        self._publisher = node.create_publisher(Bool, "~/enabled", LATCHED)
        node.create_service(SetBool, "~/enable", self._on_enable)
        self._publisher.publish(Bool(data=True))

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.on = request.data
        self._publisher.publish(Bool(data=self.on))
        response.success, response.message = True, self._on_change(self.on)
        return response
