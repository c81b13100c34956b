"""node_starter: starts nodes of a run on request, for the page."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from std_srvs.srv import Trigger

from head_tracking.ros.kit.spinning import ClosingNode, describe
from head_tracking.ros.kit.threads import UrgentServices


class NodeStarterNode(ClosingNode):
    """Offers the service `~/NAME` for each node that can be started.

    The services have a thread of their own: a start takes a second and must not delay callbacks.

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
        services = UrgentServices(self)
        self.closing.callback(services.close)
        for name in startable:
            services.offer(Trigger, f"~/{name}", partial(self._on_request, name))
        services.start()

    def _on_request(
        self, name: str, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        try:
            with self._starting:
                self._start(name)
            response.success, response.message = True, f"{name} is running"
        except Exception as error:
            response.message = describe(error)
            self.get_logger().error(f"{name} cannot start: {response.message}")
        return response
