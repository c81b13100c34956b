"""node_starter: starts nodes of a run when somebody asks for them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.node import Node, NodeNameNonExistentError
from std_srvs.srv import SetBool, Trigger

from head_tracking.control import ControlLoop
from head_tracking.ros.own_thread import OwnThread
from head_tracking.ros.spinning import describe

_ENABLING = 5.0  # s


class NodeStarterNode(Node):
    """Offers a service for each node that can be started, by its name.

    Starting takes a while, and waits for other nodes: it has a thread of its own. A node that can
    be switched on is switched on, which lets it take the joints over from the one that has them.

    Args:
        start: starts a node by its name, unless it runs already.
        startable: the names.
        loop: of the process.
    """

    def __init__(
        self,
        start: Callable[[str], None],
        startable: Sequence[str],
        loop: ControlLoop,
        **options: Any,
    ) -> None:
        super().__init__("node_starter", **options)
        self._epoch = loop.owners.epoch
        self._start = start
        own = self.get_fully_qualified_name()
        self._asking = OwnThread(self, f"{self.get_name()}_asking")
        self._enable = {
            name: self._asking.node.create_client(SetBool, f"{name}/enable") for name in startable
        }
        self._answering = OwnThread(self, f"{self.get_name()}_answering")
        for name in startable:
            self._answering.node.create_service(Trigger, f"{own}/{name}", self._callback(name))
        self._asking.start()
        self._answering.start()

    def destroy_node(self) -> None:
        """Starts no more nodes."""
        self._answering.close()
        self._asking.close()
        super().destroy_node()

    def _callback(self, name: str) -> Callable[[Any, Any], Any]:
        def callback(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            epoch = self._epoch.value
            try:
                self._start(name)
            except Exception as error:
                # whatever keeps a node from starting is for the person who asked
                response.message = describe(error)
                self.get_logger().error(f"{name} does not start: {response.message}")
                return response
            if self._epoch.value != epoch:
                response.message = f"{name} runs, and the head was stopped meanwhile"
                return response
            response.success, response.message = self._switch_on(name)
            return response

        return callback

    def _switch_on(self, name: str) -> tuple[bool, str]:
        """Whether a node that was started does its work, and the words for it."""
        client = self._enable[name]
        try:
            offered = self.get_service_names_and_types_by_node(name, self.get_namespace())
        except NodeNameNonExistentError:
            return False, f"{name} was started and has gone again"
        if f"{self.get_namespace().rstrip('/')}/{name}/enable" not in dict(offered):
            return True, f"{name} runs"
        if not client.wait_for_service(_ENABLING):
            return False, f"{name} was started and does not answer"
        answered = threading.Event()
        future = client.call_async(SetBool.Request(data=True))
        future.add_done_callback(lambda _: answered.set())
        if not answered.wait(_ENABLING):
            client.remove_pending_request(future)
            return False, f"{name} was started and does not answer"
        answer = future.result()
        said = "is switched on" if answer.success else f"is not switched on: {answer.message}"
        return bool(answer.success), f"{name} runs and {said}"
