"""node_starter: starts nodes of a run when somebody asks for them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.node import Node
from std_srvs.srv import Trigger

from head_tracking.ros.spinning import describe


class NodeStarterNode(Node):
    """Offers a service for each node that can be started, by its name.

    Args:
        start: starts a node by its name, unless it runs already.
        startable: the names.
    """

    def __init__(
        self, start: Callable[[str], None], startable: Sequence[str], **options: Any
    ) -> None:
        super().__init__("node_starter", **options)
        self._start = start
        for name in startable:
            self.create_service(Trigger, f"~/{name}", self._callback(name))

    def _callback(self, name: str) -> Callable[[Any, Any], Any]:
        def callback(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            try:
                self._start(name)
            except Exception as error:
                # whatever keeps a node from starting is for the person who asked
                response.message = describe(error)
                self.get_logger().error(f"{name} does not start: {response.message}")
            else:
                response.success, response.message = True, f"{name} runs"
            return response

        return callback
