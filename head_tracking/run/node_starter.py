"""node_starter: starts nodes of a run when somebody asks for them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from std_srvs.srv import Trigger

from head_tracking.ros.kit.closing_node import ClosingNode
from head_tracking.ros.kit.spinning import describe
from head_tracking.ros.kit.urgent_services import UrgentServices


class NodeStarterNode(ClosingNode):
    """Offers a service for each node that can be started, by its name.

    Starting takes a while, and waits for other nodes, but not for those of this process.

    Args:
        start: starts a node by its name, unless it runs already.
        startable: the names.
    """

    def __init__(
        self, start: Callable[[str], None], startable: Sequence[str], **options: Any
    ) -> None:
        super().__init__("node_starter", **options)
        self._start = start
        self._starting = threading.Lock()
        self._answering = UrgentServices(self)
        self.closing.callback(self._answering.close)
        for name in startable:
            self._answering.offer(Trigger, f"~/{name}", partial(self._on_request, name))
        self._answering.start()

    def _on_request(
        self, name: str, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        try:
            with self._starting:
                self._start(name)
            response.success, response.message = True, f"{name} runs"
        except Exception as error:  # whatever keeps a node from starting is the answer
            response.message = describe(error)
            self.get_logger().error(f"{name} does not start: {response.message}")
        return response
